"""The Python reference, from ``__all__`` and the docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import mavhums
from mavhums import learn

__all__ = ["MODULES", "members", "render", "undocumented"]

MODULES: tuple[ModuleType, ...] = (mavhums, learn)

_SECTION = re.compile(r"^(\w[\w ]*)\n-+$", re.MULTILINE)


def members(owner: Any) -> Iterator[tuple[str, Any]]:
    """Yield the public methods and properties that a class itself defines, by name."""
    if not inspect.isclass(owner):
        return
    for name, value in sorted(vars(owner).items()):
        plain = value.__func__ if isinstance(value, staticmethod | classmethod) else value
        if not name.startswith("_") and (inspect.isfunction(plain) or isinstance(plain, property)):
            yield name, plain


def undocumented() -> list[str]:
    """Return the public names without a docstring of their own."""
    missing = []
    for module in MODULES:
        for name in module.__all__:
            value = getattr(module, name)
            if callable(value) and not vars(value).get("__doc__", value.__doc__):
                missing.append(f"{module.__name__}.{name}")
            missing += [f"{module.__name__}.{name}.{key}" for key, one in members(value) if not one.__doc__]
    return missing


def render() -> str:
    """Return a chapter for each public module."""
    parts = []
    for module in MODULES:
        parts.append(f"## {module.__name__}\n\n{_summary(module)}")
        names = sorted(module.__all__, key=str.lower)
        parts += [_entry(module.__name__, name, getattr(module, name)) for name in names]
    return "\n\n".join(parts)


def _entry(module: str, name: str, value: Any) -> str:
    heading = f"### {module}.{name}"
    if inspect.isfunction(value) or inspect.isclass(value):
        heading += f"\n\n```text\n{name}{_signature(value)}\n```"
    text = f"{heading}\n\n{_markdown(inspect.getdoc(value) or '')}"
    rows = [f"- `{key}{_signature(one)}`: {_summary(one)}" for key, one in members(value)]
    return f"{text}\n\n**Methods and properties**\n\n" + "\n".join(rows) if rows else text


def _signature(value: Any) -> str:
    if isinstance(value, property):
        return ""
    try:
        signature = inspect.signature(value)
    except ValueError:
        return "(…)"
    bare = [
        one.replace(annotation=inspect.Parameter.empty)
        for one in signature.parameters.values()
        if one.name != "self"
    ]
    return str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))


def _summary(value: Any) -> str:
    text = (inspect.getdoc(value) or "").split("\n\n")[0]
    return _inline(" ".join(text.split()))


def _markdown(docstring: str) -> str:
    """Return a numpy-style docstring as Markdown."""
    pieces = _SECTION.split(docstring)
    parts = [_inline(pieces[0].strip())]
    for title, body in zip(pieces[1::2], pieces[2::2], strict=True):
        text = body.strip("\n")
        content = f"```pycon\n{text.strip()}\n```" if title == "Examples" else _definitions(text)
        parts.append(f"**{title}**\n\n{content}")
    return "\n\n".join(part for part in parts if part)


def _definitions(body: str) -> str:
    """Return the entries of a section as a list; text that is no entry stays as it is."""
    if not re.search(r"^ +\S", body, re.MULTILINE):
        return _inline(body.strip())
    rows: list[str] = []
    for line in body.splitlines():
        if line and not line.startswith(" "):
            rows.append(f"- `{line.strip()}`:")
        elif line.strip():
            rows[-1] += " " + _inline(line.strip())
    return "\n".join(rows)


def _inline(text: str) -> str:
    text = re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", text)
    return text.replace("``", "`")
