"""Errors of airframe profiles: the line, the key, the problem and the remedy.

tomllib gives no line numbers, so the line of a key is found by parsing the text up to it. That a
message has the fields that a profile maps is known for MAVLink before a log is read. The records of an
on-board log are defined in the log itself, so their fields are checked when the first of them arrives.
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_left
from collections.abc import Iterable, Mapping
from functools import reduce
from operator import getitem
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from mavhums.core.quantities import KEYS

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

Place = tuple[str | int, ...]

MULTI_ID = "multi_id"
"""Selects an instance of a ULog topic in ``where``."""

_ON_BOARD = re.compile(r"[A-Z][A-Z0-9]{0,3}|[a-z][a-z0-9_]*")  # a DataFlash record, or a ULog topic
_POSITION = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")
_EXAMPLE = "write it as in the packaged profile paper.toml"


def explain_syntax(path: str, text: str, message: str) -> tuple[str, str]:
    """Return problem and remedy for a text that is not TOML, from tomllib's message.

    Examples
    --------
    >>> explain_syntax("mine.toml", "servo =", "Invalid value (at line 1, column 8)")[0]
    'mine.toml:1: not valid TOML: Invalid value, at column 8'
    """
    position = _POSITION.search(message)
    what = _POSITION.sub("", message)
    line = position[1] if position else None
    if line is None:
        return f"{path}:{max(1, len(text.splitlines()))}: not valid TOML: {what}, at its end", _EXAMPLE
    column = position[2] if position else ""
    return f"{path}:{line}: not valid TOML: {what}, at column {column}", _EXAMPLE


def explain_values(
    path: str, text: str, error: ValidationError, sections: Mapping[Place, tuple[str, ...]]
) -> tuple[str, str]:
    """Return problem and remedy for a profile's most important error.

    Parameters
    ----------
    path, text
        Path and text of the profile.
    error
        Error of its validation.
    sections
        The keys of each section, by its path without indices and quantities.
    """
    # A misspelt key is also missing under its correct name; the misspelling is the cause.
    mistakes = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    first = mistakes[0]
    place = _place(first)
    line = line_of(place, text)
    where = f"{path}:{line}" if line else path
    name = _in_words(place)
    problem = f"{where}: {name}: {_what(first)}" if name else f"{where}: {_what(first)}"
    more = len({_place(mistake) for mistake in mistakes[1:] if not _follows(mistake, first)} - {place})
    remedy = _remedy(first, place, sections)
    return problem, f"{remedy}; then look at {more} more" if more else remedy


def _follows(mistake: ErrorDetails, first: ErrorDetails) -> bool:
    """Return whether an error is a consequence: of a misspelt key, or of an error inside a list."""
    misspelt = first["type"] == "extra_forbidden" and mistake["type"] == "missing"
    encloses = first["loc"][: len(mistake["loc"])] == mistake["loc"]
    return encloses or (misspelt and mistake["loc"][:-1] == first["loc"][:-1])


def _place(mistake: ErrorDetails) -> Place:
    """Return the path in the TOML text of an error."""
    context: dict[str, Any] = mistake.get("ctx", {})
    if "place" in context:
        return tuple(context["place"])
    place = tuple(part for part in mistake["loc"] if part != "[key]")
    return (*place, context["key"]) if "key" in context else place


def _in_words(place: Place) -> str:
    """Format a path in TOML notation, with actuators numbered from 1."""
    words = ""
    for part in place:
        words += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if words else part
    return words


def _what(mistake: ErrorDetails) -> str:
    known = {"extra_forbidden": "no such key", "missing": "missing"}
    return known.get(mistake["type"], mistake["msg"].removeprefix("Value error, "))


def _remedy(mistake: ErrorDetails, place: Place, sections: Mapping[Place, tuple[str, ...]]) -> str:
    key = str(place[-1]) if place else ""
    match mistake["type"]:
        case "extra_forbidden":
            outer = tuple(part for part in place[:-1] if isinstance(part, str) and part not in KEYS)
            known = sections.get(outer, ())
            close = _close(key, known, 1)
            return f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
        case "mapping":
            return str(mistake["ctx"]["remedy"])
        case "shared":
            return f"give each actuator a {key} of its own"
        case "missing" if isinstance(place[-1], int):
            return _EXAMPLE
        case "missing" if len(place) == 1:
            return f"add {key}"
        case "missing":
            return f"add {key} to {_in_words(place[:-1])}"
        case _ if isinstance(mistake["input"], (str, int, float)):
            return f"mend the value {mistake['input']!r}"
        case _:
            return _EXAMPLE


def line_of(place: Place, text: str) -> int | None:
    """Return the line, from 1, on which a place of a valid TOML text begins; None if nothing encloses it.

    A place is the path to a value, with indices for elements of arrays of tables. Values inside an
    inline table or array have the line where that begins, and what is missing that of what encloses it.

    Examples
    --------
    >>> text = "name = 'x'\\n[[part]]\\nid = 1\\n[[part]]\\nid = 2\\n"
    >>> line_of(("part", 1, "id"), text), line_of(("part", 1, "colour"), text)
    (5, 4)
    """
    rows = text.splitlines(keepends=True)

    def is_known(line: int) -> bool:
        """Return whether the statements that begin up to a line hold the place."""
        while True:
            try:
                parsed = tomllib.loads("".join(rows[:line]))
                break
            except tomllib.TOMLDecodeError:  # a statement goes on
                line += 1
        try:
            reduce(getitem, place, cast(Any, parsed))
        except (KeyError, IndexError, TypeError):
            return False
        return True

    line = bisect_left(range(1, len(rows) + 1), True, key=is_known) + 1
    if not place or line <= len(rows):
        return line if place else None
    return line_of(place[:-1], text)


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
        return FieldMistake("message", f"no message {message}", nearest(message.upper(), wires))
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
        return FieldMistake("field", f"{message} has no field {name}", nearest(name, names))
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
        return FieldMistake("where", f"{message} has no field {name}", nearest(name, names))
    if wire[name].shape:
        return FieldMistake("where", f"{name} of {message} is an array", "choose rows by a single value")
    if (wire[name].kind == "S") != isinstance(value, str):
        kind = "text" if wire[name].kind == "S" else "a number"
        return FieldMistake("where", f"{name} of {message} is {kind}, not {value!r}", f"compare with {kind}")
    return None


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the remedy for a name that is not known: the nearest names, or those that there are."""
    close = _close(name, sorted(known), 2)
    return f"did you mean {' or '.join(close)}?" if close else f"there are: {', '.join(sorted(known)[:20])}"


def _close(name: str, known: Iterable[str], count: int) -> list[str]:
    from difflib import get_close_matches

    return get_close_matches(name, [*known], n=count)
