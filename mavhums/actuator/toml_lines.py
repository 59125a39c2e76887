"""Line numbers of the tables and keys of a TOML text, which tomllib does not provide."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterator

__all__ = ["Place", "line_of", "lines"]

Place = tuple[str | int, ...]


def lines(text: str) -> dict[Place, int]:
    """Return the line, from 1, of every table and key of a valid TOML text.

    A place is the path to a value, with indices for elements of arrays of tables. Values inside an
    inline table or array have the line where that begins.

    Examples
    --------
    >>> lines("name = 'x'\\n[[part]]\\nid = 1\\n[[part]]\\nid = 2\\n")[("part", 1, "id")]
    5
    """
    found: dict[Place, int] = {}
    sizes: Counter[Place] = Counter()
    table: Place = ()
    for line, statement, parsed in _statements(text):
        if statement.startswith("["):
            table = _table(parsed, sizes)
            found.setdefault(table, line)
        else:
            for place in _places(parsed):
                found.setdefault(table + place, line)
    return found


def line_of(place: Place, known: dict[Place, int]) -> int | None:
    """Return the line of a place, else the line of its nearest known parent; None if there is none.

    Examples
    --------
    >>> line_of(("part", 0, "colour"), {("part", 0): 2})
    2
    """
    within = (place[:size] for size in range(len(place), 0, -1))
    return next((known[outer] for outer in within if outer in known), None)


def _statements(text: str) -> Iterator[tuple[int, str, dict[str, object]]]:
    """Yield line, text and parsed value of each table header and each key.

    A statement ends with the first line that makes it valid TOML.
    """
    start, pending = 1, ""
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        if not pending:
            start = number
        pending += line
        try:
            parsed = tomllib.loads(pending)
        except tomllib.TOMLDecodeError:
            continue
        if parsed:
            yield start, pending.lstrip(), parsed
        pending = ""


def _table(header: dict[str, object], sizes: Counter[Place]) -> Place:
    """Return the place of the table that a header opens, and count it if it is an array element."""
    place: Place = ()
    inner: object = header
    while inner:
        if isinstance(inner, list):
            sizes[place] += 1
            return (*place, sizes[place] - 1)
        assert isinstance(inner, dict)
        if sizes[place]:
            place = (*place, sizes[place] - 1)
        key, inner = next(iter(inner.items()))
        place = (*place, key)
    return place


def _places(value: object, place: Place = ()) -> Iterator[Place]:
    if place:
        yield place
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _places(inner, (*place, key))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _places(inner, (*place, k))
