"""What the pages take from the code: fields of JSON and of the profile, public names, links to files.

A page names a table, ``<!-- fields: mavhums analyse --json -->``; the site fills it in from the model's JSON
schema and the descriptions in ``reference/fields.toml``. What is read in the repository, too, is between
``<!-- from the code: NAME -->`` and ``<!-- end -->``: ``python docs/hooks.py`` renews it. A link that leaves
``docs`` works on GitHub; on the site it becomes an address of the repository. What is missing is a warning,
and a strict build fails on it (with ``--quiet`` it would not: mkdocs then counts no warnings).
"""

from __future__ import annotations

import inspect
import logging
import os
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import mavhums
from mavhums import learn
from mavhums.actuator.profile import Airframe
from mavhums.results import assessment
from mavhums.results.assessment import Inspection
from mavhums.results.standing import FleetDigest, TrendReport

DOCS = Path(__file__).parent
DESCRIPTIONS = DOCS / "reference" / "fields.toml"
PROFILE = "profile"

Schema = dict[str, Any]

_ANY = "any"
_LEAST, _MOST = 1e-12, 1e9  # bounds that only keep a number positive and finite
_FIELDS = re.compile(r"<!-- fields: (.+?) -->")
_FROM_CODE = re.compile(r"(?<=<!-- from the code: )(\S+)( -->\n).*?(?=<!-- end -->)", re.DOTALL)
_LINK = re.compile(r"(?<=\]\()(\.\./[^)\s#]+)")
_ROLE = re.compile(r":\w+:(?=<code>)(<code>)~?\.?")
_log = logging.getLogger("mkdocs.hooks.mavhums")  # a warning below "mkdocs" fails a strict build


class _File(Protocol):
    src_uri: str


class _Page(Protocol):
    file: _File


def on_pre_build(config: Any) -> None:
    """Warn of descriptions whose field is gone."""
    for name in unused():
        _log.warning("%s describes %s, which does not exist", DESCRIPTIONS.name, name)


def on_page_markdown(markdown: str, page: _Page, config: Any, **_: object) -> str:
    """Fill in a page's tables of fields, and turn its links out of ``docs`` into addresses."""
    source = page.file.src_uri

    def address(link: re.Match[str]) -> str:
        target = (DOCS / source).parent.joinpath(link[1]).resolve()
        if target.is_relative_to(DOCS):
            return link[1]
        if not target.exists():
            _log.warning("%s links to %s, which does not exist", source, link[1])
        path = Path(os.path.relpath(target, DOCS.parent)).as_posix()
        return f"{config['extra']['repository']}/blob/main/{path}"

    return _LINK.sub(address, _FIELDS.sub(lambda mark: table(mark[1]), markdown))


def on_page_content(html: str, **_: object) -> str:
    """Leave out the roles in docstrings, which Markdown does not know."""
    return _ROLE.sub(r"\1", html)


def schemas() -> dict[str, Schema]:
    """Return the schemas of what mavhums prints as JSON, by command, and of the profile."""
    inspection = Inspection.model_json_schema(by_alias=True, mode="serialization")
    assessment.without_record(inspection["$defs"])
    return {
        "mavhums analyse --json": assessment.json_schema(),
        "mavhums live --json": assessment.json_schema("live-1"),
        "mavhums trend --json": TrendReport.model_json_schema(by_alias=True, mode="serialization"),
        "mavhums fleet digest --json": FleetDigest.model_json_schema(by_alias=True, mode="serialization"),
        "mavhums inspect --json": inspection,
        PROFILE: Airframe.model_json_schema(by_alias=True, mode="validation"),
    }


def table(name: str) -> str:
    """Return the tables of a schema's objects; an object that an earlier schema has is described there."""
    every = schemas()
    earlier = {one for key in list(every)[: list(every).index(name)] for one, _ in objects(every[key])}
    return "\n\n".join(_table(key, one) for key, one in objects(every[name]) if key not in earlier)


def renewed(page: str) -> str:
    """Return a page with its lists as the code has them now."""
    modules = {"mavhums": mavhums, "mavhums.learn": learn}

    def text(mark: re.Match[str]) -> str:
        lines = profile() if mark[1] == PROFILE else names(modules[mark[1]])
        return f"{mark[1]}{mark[2]}\n{lines}\n\n"

    return _FROM_CODE.sub(text, page)


def profile() -> str:
    """Return a list of each section's fields, with type, bounds and default."""
    return "\n\n".join(_section(key, one) for key, one in objects(schemas()[PROFILE]))


def names(module: Any) -> str:
    """Return a list of what a user calls or gets, with summaries, and of the errors or parts beside it."""
    values = {key: getattr(module, key) for key in module.__all__}
    errors = [one for one in values.values() if inspect.isclass(one) and issubclass(one, Exception)]
    rest = [
        key
        for key, one in values.items()
        if one in errors or (module is learn and not (inspect.isfunction(one) or hasattr(one, "fit")))
    ]
    texts = {key: (inspect.getdoc(one) or "").split("\n\n")[0] for key, one in values.items()}
    lines = [f"- `{key}`: {_plain(text)}" for key, text in texts.items() if key not in rest]
    return "\n".join([*lines, "", f"Beside these: {', '.join(f'`{key}`' for key in rest)}."])


def objects(schema: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield the objects of a schema by name, the outermost first."""
    if "properties" in schema:
        yield schema["title"], schema
    for name, one in sorted(schema.get("$defs", {}).items()):
        if "properties" in one:
            yield name, one


def unused() -> list[str]:
    """Return the descriptions in ``fields.toml`` of fields that do not exist."""
    known = {(o, key) for one in schemas().values() for o, part in objects(one) for key in part["properties"]}
    keys = {key for _, key in known}
    return sorted(
        f"{section}.{key}"
        for section, texts in _descriptions().items()
        for key in texts
        if (key not in keys if section == _ANY else (section, key) not in known)
    )


@cache
def _descriptions() -> dict[str, dict[str, str]]:
    return tomllib.loads(DESCRIPTIONS.read_text(encoding="utf-8"))


def _described(section: str, key: str) -> str | None:
    return _descriptions().get(section, {}).get(key) or _descriptions()[_ANY].get(key)


def _described_fields(name: str, schema: Schema) -> Iterator[tuple[str, Schema, str]]:
    for key, value in schema["properties"].items():
        text = value.get("description") or _described(name, key)
        if text is None:
            _log.warning("%s.%s: give the field a description, or add it to %s", name, key, DESCRIPTIONS.name)
        yield key, value, text or ""


def _summary(schema: Schema) -> str:
    return _plain(schema.get("description", "").split("\n\n")[0])


def _plain(text: str) -> str:
    return re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", " ".join(text.split()).replace("``", "`"))


def _table(name: str, schema: Schema) -> str:
    head = [f"### {name}", "", _summary(schema), "", _row(["field", "type", "meaning"]), _row(["---"] * 3)]
    rows = [_row([f"`{key}`", _type(one), text]) for key, one, text in _described_fields(name, schema)]
    return "\n".join([*head, *rows])


def _section(name: str, schema: Schema) -> str:
    required = schema.get("required", [])
    fields = []
    for key, one, text in _described_fields(name, schema):
        kind = _type(one).removesuffix(" or null").removeprefix("number ")
        default = _default(one, required=key in required)
        fields.append(f"- `{key}` ({'; '.join(filter(None, (kind, default)))}): {text}")
    return "\n".join([f"## {name}", "", _summary(schema), "", *fields])


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _default(value: Schema, *, required: bool) -> str:
    default = value.get("default")
    if required:
        return "required"
    return f"`{default}`" if default not in (None, "", {}) and not isinstance(default, dict) else ""


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
        return f"list of {_type(value.get('items', {}))}" if "items" in value else "numbers"
    if value.get("type") == "object":
        inner = value.get("additionalProperties")
        return f"object of {_type(inner)}" if isinstance(inner, dict) else "object"
    return f"{value.get('type', 'any')}{_bounds(value)}"


def _bounds(value: Schema) -> str:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    found = [
        "> 0" if value[key] == _LEAST else f"{sign} {value[key]:g}"
        for key, sign in signs.items()
        if key in value and abs(value[key]) != _MOST
    ]
    return f" {', '.join(found)}" if found else ""


if __name__ == "__main__":
    for path in sorted(DOCS.rglob("*.md")):
        path.write_text(renewed(path.read_text(encoding="utf-8")), encoding="utf-8")
