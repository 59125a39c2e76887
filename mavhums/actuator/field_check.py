"""Check that messages have the fields that a profile maps.

MAVLink's are known before a log is read. The records of an on-board log are defined in the log itself, so
their fields are checked when the first of them arrives.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np

__all__ = ["MULTI_ID", "FieldMistake", "field_mistake", "wire_mistake"]

MULTI_ID = "multi_id"
"""Selects an instance of a ULog topic in ``where``."""

_ON_BOARD = re.compile(r"[A-Z][A-Z0-9]{0,3}|[a-z][a-z0-9_]*")  # a DataFlash record, or a ULog topic


class FieldMistake(NamedTuple):
    """An error in a mapping: the key, the problem and the remedy."""

    key: str
    problem: str
    remedy: str


def field_mistake(message: str, field: str, where: Mapping[str, str | int]) -> FieldMistake | None:
    """Check a mapping against the MAVLink dialect; return its error, or None.

    A message that may be a DataFlash record (``CSRV``) or a ULog topic (``esc_status``) has no error here.

    Examples
    --------
    >>> field_mistake("NAMED_VALUE_FLOAT", "value", {"name": "S1Pos"})
    >>> field_mistake("ESC_TELEMETRY_1_TO_4", "rpm[4]", {}).problem
    'rpm of ESC_TELEMETRY_1_TO_4 has 4 elements'
    """
    from mavhums.log.mavlink.dialect import load_dialect

    wires = {definition.name: definition.wire for definition in load_dialect().definitions.values()}
    if message not in wires:
        if _ON_BOARD.fullmatch(message):
            return None
        return FieldMistake("message", f"no message {message}", _near(message.upper(), wires))
    return wire_mistake(message, field, where, wires[message])


def wire_mistake(
    message: str, field: str, where: Mapping[str, str | int], wire: np.dtype[np.void]
) -> FieldMistake | None:
    """Check a mapping against the fields of a message; return its error, or None.

    Examples
    --------
    >>> wire = np.dtype([("Id", "u1"), ("Pos", "f4"), ("esc[0].rpm", "f4")])
    >>> wire_mistake("CSRV", "Pos", {"Id": 3}, wire), wire_mistake("CSRV", "esc[0].rpm", {}, wire)
    (None, None)
    >>> wire_mistake("CSRV", "Posn", {}, wire)
    FieldMistake(key='field', problem='CSRV has no field Posn', remedy='did you mean Pos?')
    """
    wanted = _field_mistake(message, field, wire)
    conditions = (_condition_mistake(message, name, value, wire) for name, value in where.items())
    return wanted or next((mistake for mistake in conditions if mistake), None)


def _field_mistake(message: str, field: str, wire: np.dtype[np.void]) -> FieldMistake | None:
    names = wire.names or ()
    name, _, element = (field, "", "") if field in names else field.rpartition("[")
    name = name or field
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
    if name == MULTI_ID and name not in names and isinstance(value, int):
        return None
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
