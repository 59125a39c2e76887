"""Check that messages have the fields that a profile maps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np

__all__ = ["FieldMistake", "field_mistake"]


class FieldMistake(NamedTuple):
    """An error in a mapping: the key, the problem and the remedy."""

    key: str
    problem: str
    remedy: str


def field_mistake(message: str, field: str, where: Mapping[str, str | int]) -> FieldMistake | None:
    """Check a mapping against the MAVLink dialect; return its error, or None.

    Examples
    --------
    >>> field_mistake("NAMED_VALUE_FLOAT", "value", {"name": "S1Pos"})
    >>> field_mistake("ESC_TELEMETRY_1_TO_4", "rpm[4]", {}).problem
    'rpm of ESC_TELEMETRY_1_TO_4 has 4 elements'
    """
    from mavhums.log.mavlink.dialect import load_dialect

    wires = {definition.name: definition.wire for definition in load_dialect().definitions.values()}
    if message not in wires:
        return FieldMistake("message", f"no message {message}", _near(message, wires))
    wire = wires[message]
    wanted = _field_mistake(message, field, wire)
    conditions = (_condition_mistake(message, name, value, wire) for name, value in where.items())
    return wanted or next((mistake for mistake in conditions if mistake), None)


def _field_mistake(message: str, field: str, wire: np.dtype[np.void]) -> FieldMistake | None:
    name, _, element = field.partition("[")
    names = wire.names or ()
    if name not in names:
        return FieldMistake("field", f"{message} has no field {name}", _near(name, names))
    shape = wire[name].shape
    if wire[name].base.kind == "S":
        return FieldMistake("field", f"{name} of {message} is text", "map a number")
    if shape and not element:
        return FieldMistake("field", f"{name} of {message} is an array", f"name an element: {name}[0]")
    if element and not shape:
        return FieldMistake("field", f"{name} of {message} is no array", f"write {name}")
    if element and int(element.rstrip("]")) >= shape[0]:
        return FieldMistake(
            "field", f"{name} of {message} has {shape[0]} elements", f"the last is {name}[{shape[0] - 1}]"
        )
    return None


def _condition_mistake(
    message: str, name: str, value: str | int, wire: np.dtype[np.void]
) -> FieldMistake | None:
    names = wire.names or ()
    if name not in names:
        return FieldMistake("where", f"{message} has no field {name}", _near(name, names))
    if wire[name].shape:
        return FieldMistake("where", f"{name} of {message} is an array", "choose rows by a single value")
    if (wire[name].kind == "S") != isinstance(value, str):
        kind = "text" if wire[name].kind == "S" else "a number"
        return FieldMistake("where", f"{name} of {message} is {kind}, not {value!r}", f"compare with {kind}")
    return None


def _near(name: str, known: Iterable[str]) -> str:
    close = get_close_matches(name, sorted(known), n=2)
    return f"did you mean {' or '.join(close)}?" if close else f"there are: {', '.join(sorted(known)[:20])}"
