"""Where the surfaces of an airframe lie, by their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

__all__ = ["V_TAIL", "Place", "kind", "places"]


class Place(NamedTuple):
    """Hinge position of a surface: x forward, y left, z up; the half-span is 1.

    Attributes
    ----------
    x, z
        Position of the hinge line.
    span
        Start and end along the hinge line.
    chord
        Length behind the hinge line.
    roll
        Rotation of the hinge line about x, degrees; 90 for a fin.
    """

    x: float
    z: float
    span: tuple[float, float]
    chord: float
    roll: float = 0.0


V_TAIL: Final = "ruddervator|v.?tail"
_PLACES: Final[tuple[tuple[str, Place], ...]] = (
    (V_TAIL, Place(-0.86, 0.04, (0.06, 0.4), 0.12, 38.0)),
    ("rudder", Place(-0.86, 0.03, (0.05, 0.36), 0.13, 90.0)),
    ("elevator|stabil", Place(-0.86, 0.03, (0.04, 0.38), 0.12)),
    ("canard", Place(0.5, 0.02, (0.08, 0.34), 0.1)),
    ("spoiler|brake", Place(0.02, 0.05, (0.3, 0.62), 0.1)),
    ("flaperon|elevon|aileron", Place(-0.16, 0.03, (0.5, 0.98), 0.14)),
    ("flap", Place(-0.16, 0.03, (0.1, 0.48), 0.14)),
)
_ELSEWHERE: Final = Place(0.1, -0.3, (-0.6, 0.6), 0.1)
_WHOLE: Final = ("elevator|stabil", "canard")
_SIDED: Final = (V_TAIL, "spoiler|brake", "flaperon|elevon|aileron", "flap")
_LEFT, _RIGHT = (
    re.compile(r"left|port|(^|[_ -])l($|[_ -])"),
    re.compile(r"right|starboard|(^|[_ -])r($|[_ -])"),
)


def kind(text: str) -> str:
    """Return the kind of surface that a text names; empty if it names none."""
    return next((kind for kind, _ in _PLACES if re.search(kind, text.lower())), "")


def places(texts: Sequence[str]) -> list[Place]:
    """Assign a hinge position to each text that names a surface; like ones share the span."""
    slots: list[tuple[str, int]] = []
    sideless: list[str] = []
    for text in map(str.lower, texts):
        what = kind(text)
        side = 1 if _LEFT.search(text) else -1 if _RIGHT.search(text) else 0
        if side == 0 and what in _SIDED:
            side = -1 if sideless.count(what) % 2 else 1
            sideless.append(what)
        slots.append((what, side))
    return [
        _slot(what, side, slots[:k].count((what, side)), slots.count((what, side)))
        for k, (what, side) in enumerate(slots)
    ]


def _slot(what: str, side: int, number: int, of: int) -> Place:
    """Return the part of a hinge position for one of several actuators that share it."""
    place = dict(_PLACES).get(what, _ELSEWHERE)
    begin, end = place.span
    if side == 0 and what in _WHOLE:
        begin = -end
    sign = -1 if side < 0 and what in {*_SIDED, *_WHOLE} else 1
    step = (end - begin) / of
    span = (sign * (begin + number * step), sign * (begin + (number + 1) * step))
    return place._replace(span=span, roll=sign * place.roll if what == V_TAIL else place.roll)
