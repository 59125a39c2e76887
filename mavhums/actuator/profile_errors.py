"""Error messages for airframe profiles: the line, the key, the problem and the remedy."""

from __future__ import annotations

import re
from collections.abc import Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from mavhums.actuator.toml_lines import Place, line_of, lines
from mavhums.core.quantities import KEYS

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

__all__ = ["explain_syntax", "explain_values"]

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
    line = line_of(place, lines(text))
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
    match mistake["type"]:
        case "extra_forbidden":
            return "no such key"
        case "missing":
            return "missing"
        case "value_error":
            return mistake["msg"].removeprefix("Value error, ")
        case _:
            return mistake["msg"]


def _remedy(mistake: ErrorDetails, place: Place, sections: Mapping[Place, tuple[str, ...]]) -> str:
    key = str(place[-1]) if place else ""
    match mistake["type"]:
        case "extra_forbidden":
            outer = tuple(part for part in place[:-1] if isinstance(part, str) and part not in KEYS)
            known = sections.get(outer, ())
            close = get_close_matches(key, known, n=1)
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
