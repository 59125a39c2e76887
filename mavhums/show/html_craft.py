"""The aircraft's outline from above, with its surfaces in the colour of their condition."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from math import cos, radians
from typing import Final, NamedTuple

from mavhums.core.conditions import URGENCY, Condition
from mavhums.report.assessment import ALL, Verdict
from mavhums.show._places import V_TAIL, Place, kind, places

__all__ = ["Part", "outline"]

_SCALE: Final = 150.0
_MIDDLE: Final = (160.0, 130.0)
_FIN: Final = 0.05
_MOST: Final = 32
_SIDE: Final = re.compile("left|right|port|starboard|[_ -][lr]$")


class Part(NamedTuple):
    """A surface on the drawing: its name, its condition, the corners of each side, and where its sign is.

    ``by`` is the axis whose condition it is, where the surface has none of its own.
    """

    name: str
    condition: Condition
    by: str
    points: tuple[str, ...]
    x: float
    y: float


def outline(verdicts: Iterable[Verdict]) -> list[Part]:
    """Return the surfaces of one aircraft.

    A surface that is an actuator of its own has that actuator's condition, or its axis's where that is
    graver or its own says nothing. Names that are of no surface of a wing or a tail are left out.
    """
    found: dict[str, tuple[Condition, str]] = {}
    for verdict in verdicts:
        moved = verdict.surfaces if verdict.subject == "axis" else (verdict.actuator,)
        by = f"{verdict.actuator} control" if verdict.subject == "axis" else ""
        for name in moved:
            if name != ALL and kind(name):
                own = verdict.gravest, by
                found[name] = max(found.get(name, own), own, key=lambda held: _weight(held[0]))
    shown = list(found)[:_MOST]
    kinds = [kind(name) for name in shown]
    return [
        _part(name, *found[name], place, both=kinds.count(what) == 1 and not _SIDE.search(name.lower()))
        for name, what, place in zip(shown, kinds, places(shown), strict=True)
    ]


def _weight(condition: Condition) -> int:
    """Return what outranks what on a drawing: nothing known yields to any answer."""
    return -1 if condition in ("unmonitored", "undecided") else URGENCY[condition]


def _part(name: str, condition: Condition, by: str, place: Place, *, both: bool) -> Part:
    """Return the drawing of a surface; one output that moves ``both`` sides is drawn on both."""
    corners = _corners(place, fin="rudder" in kind(name) and kind(name) != V_TAIL)
    drawn = [(_MIDDLE[0] - _SCALE * y, _MIDDLE[1] - _SCALE * x) for x, y in corners]
    middle = [sum(axis) / len(drawn) for axis in zip(*drawn, strict=True)]
    mirrored = [(2 * _MIDDLE[0] - x, y) for x, y in drawn]
    sides = [drawn, mirrored] if both and place.span[0] > 0 and place.roll == 0 else [drawn]
    points = tuple(" ".join(f"{x:.1f},{y:.1f}" for x, y in side) for side in sides)
    return Part(name, condition, by, points, round(middle[0], 1), round(middle[1], 1))


def _corners(place: Place, *, fin: bool) -> Sequence[tuple[float, float]]:
    """Return the corners seen from above: x forward, y left."""
    begin, end = place.span
    back = place.x - place.chord
    if fin:
        return [(back, -_FIN), (back, _FIN), (back - place.chord, _FIN), (back - place.chord, -_FIN)]
    flat = cos(radians(place.roll))
    return [
        (place.x, begin * flat),
        (place.x, end * flat),
        (back, end * flat),
        (back, begin * flat),
    ]
