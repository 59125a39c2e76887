"""The JSON and profile references, from the models' JSON schemas and the descriptions in ``fields.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from mavhums.actuator.profile import Airframe
from mavhums.report import assessment, live
from mavhums.report.inspection import Inspection
from mavhums.report.trend import TrendReport

__all__ = ["contracts", "fields", "render_contracts", "render_profile", "undescribed", "unused"]

DESCRIPTIONS = Path(__file__).with_name("fields.toml")
_ANY = "any"

Schema = dict[str, Any]


def contracts() -> dict[str, Schema]:
    """Return the schema of everything that mavhums prints as JSON, by the command that prints it."""
    return {
        "mavhums analyse --json": assessment.json_schema(),
        "mavhums live --json": live.json_schema(),
        "mavhums trend --json": TrendReport.model_json_schema(by_alias=True, mode="serialization"),
        "mavhums inspect --json": Inspection.model_json_schema(by_alias=True, mode="serialization"),
    }


def profile() -> Schema:
    """Return the schema of an airframe profile."""
    return Airframe.model_json_schema(by_alias=True, mode="validation")


def render_contracts() -> str:
    """Return a chapter for each contract; an object that several share is described once."""
    parts, seen = [], set[str]()
    for command, schema in contracts().items():
        parts.append(f"## {command}")
        for name, one in objects(schema):
            if name not in seen:
                parts.append(_table(name, one, "###"))
                seen.add(name)
    return "\n\n".join(parts)


def render_profile() -> str:
    """Return a table for each section of a profile."""
    return "\n\n".join(_table(name, one, "##", defaults=True) for name, one in objects(profile()))


def objects(schema: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield the objects of a schema by name, the outermost first."""
    if "properties" in schema:
        yield schema["title"], schema
    for name, one in sorted(schema.get("$defs", {}).items()):
        if "properties" in one:
            yield name, one


def fields() -> set[tuple[str, str]]:
    """Return every field of every contract and of the profile, as object and field."""
    schemas = (*contracts().values(), profile())
    return {(name, key) for schema in schemas for name, one in objects(schema) for key in one["properties"]}


def undescribed() -> list[str]:
    """Return the fields that nobody described, as they are written in ``fields.toml``."""
    own = _described_in_schema()
    return sorted(f"{o}.{f}" for o, f in fields() if (o, f) not in own and _described(o, f) is None)


def unused() -> list[str]:
    """Return the descriptions in ``fields.toml`` of fields that do not exist."""
    known, keys = fields(), {key for _, key in fields()}
    return sorted(
        f"{section}.{key}"
        for section, texts in _descriptions().items()
        for key in texts
        if (key not in keys if section == _ANY else (section, key) not in known)
    )


def _described_in_schema() -> set[tuple[str, str]]:
    schemas = (*contracts().values(), profile())
    return {
        (name, key)
        for schema in schemas
        for name, one in objects(schema)
        for key, value in one["properties"].items()
        if "description" in value
    }


@cache
def _descriptions() -> dict[str, dict[str, str]]:
    return tomllib.loads(DESCRIPTIONS.read_text(encoding="utf-8"))


def _described(section: str, key: str) -> str | None:
    return _descriptions().get(section, {}).get(key) or _descriptions()[_ANY].get(key)


def _table(name: str, schema: Schema, heading: str, *, defaults: bool = False) -> str:
    summary = " ".join(schema.get("description", "").split("\n\n")[0].split()).replace("``", "`")
    titles = ["field", "type", *["default"] * defaults, "meaning"]
    rows = [f"{heading} {name}", "", summary, "", _row(titles), _row(["---"] * len(titles))]
    for key, value in schema["properties"].items():
        text = value.get("description") or _described(name, key)
        if text is None:
            problem = f"{name}.{key} has no description"
            raise LookupError(f"{problem}: give its field one, or add it to {DESCRIPTIONS.name}")
        default = [_default(value, required=key in schema.get("required", []))] * defaults
        rows.append(_row([f"`{key}`", _type(value), *default, text]))
    return "\n".join(rows)


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _default(value: Schema, *, required: bool) -> str:
    default = value.get("default")
    if required:
        return "required"
    return f"`{default}`" if default not in (None, "", {}) else "none"


def _type(value: Schema) -> str:
    """Return a schema's type in words, with its bounds."""
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in value or "oneOf" in value:
        choices: list[Schema] = value.get("anyOf") or value["oneOf"]
        return " or ".join(dict.fromkeys(map(_type, choices)))
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{one}`" for one in value["enum"])
    if value.get("type") == "array":
        return f"list of {_type(value.get('items', {}))}" if "items" in value else "list of numbers"
    if value.get("type") == "object":
        inner = value.get("additionalProperties")
        return f"object of {_type(inner)}" if isinstance(inner, dict) else "object"
    return f"{value.get('type', 'any')}{_bounds(value)}"


def _bounds(value: Schema) -> str:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    found = [f"{sign} {value[key]:g}" for key, sign in signs.items() if key in value]
    return f" {', '.join(found)}" if found else ""
