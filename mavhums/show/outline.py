"""Where the surfaces of an airframe lie, by their names, and its outline from above, in colours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from math import cos, pi, radians, sin
from typing import Final, NamedTuple

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.results.sections import OutputUsage
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.words import join


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
    mirrored
        Whether it is on the other side, too: no text names a side, or one output moves both.
    """

    x: float
    z: float
    span: tuple[float, float]
    chord: float
    roll: float = 0.0
    mirrored: bool = False


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
    """Assign a hinge position to each text that names a surface; like ones share the span.

    A text that names no side is on both: which output is the left one is not a matter of its number.
    """
    slots = []
    for text in map(str.lower, texts):
        side = 1 if _LEFT.search(text) else -1 if _RIGHT.search(text) else 0
        slots.append((kind(text), side))
    return [_slot(what, side, slots[:k].count((what, side)), slots) for k, (what, side) in enumerate(slots)]


def _slot(what: str, side: int, number: int, slots: Sequence[tuple[str, int]]) -> Place:
    """Return the part of a hinge position for one of several actuators that share it."""
    place = dict(_PLACES).get(what, _ELSEWHERE)
    begin, end = place.span
    sideless, sided = slots.count((what, 0)), max(slots.count((what, 1)), slots.count((what, -1)))
    if what not in {*_SIDED, *_WHOLE}:
        side, sideless, sided = 1, 0, sideless + slots.count((what, 1)) + slots.count((what, -1))
    elif side == 0 and what in _WHOLE and sideless == 1 and not sided:
        return place._replace(span=(-end, end))
    of = sideless + sided if sideless else slots.count((what, side)) or sided
    number += sided if side == 0 else 0
    sign = -1 if side < 0 else 1
    step = (end - begin) / of
    span = (sign * (begin + number * step), sign * (begin + (number + 1) * step))
    roll = (sign * place.roll if side else 0.0) if what == V_TAIL else place.roll
    return place._replace(span=span, roll=roll, mirrored=side == 0)


_SCALE: Final = 150.0
_MIDDLE: Final = (160.0, 130.0)
_FIN: Final = 0.05
_MOST: Final = 32
_HUB: Final = (160.0, 156.0)
_ARM: Final = 105.0
_DISC: Final = {4: 42.0, 6: 38.0}
_SMALL_DISC: Final = 30.0  # eight of them do not overlap
_CORNERS: Final = 24
FIXED_WING: Final = (
    "160,14 170,34 171,220 166,276 154,276 149,220 150,34",
    "10,110 149,104 149,154 10,152",
    "310,110 171,104 171,154 310,152",
    "100,238 154,232 154,260 100,260",
    "220,238 166,232 166,260 220,260",
)
"""Fuselage, wings and tailplane, each by its corners."""
USUAL: Final = {"roll": "aileron", "pitch": "elevator", "yaw": "rudder"}
"""The surface that moves an axis where no name says which."""


class DrawnSurface(NamedTuple):
    """A surface on the drawing: its name, its condition, the corners of each side, and where its sign is.

    ``by`` is the axis whose condition it is, where the surface has none of its own.
    """

    name: str
    condition: Condition
    by: str
    points: tuple[str, ...]
    x: float
    y: float

    @property
    def title(self) -> str:
        """The name, with the axis."""
        return f"{self.name}, by {self.by}" if self.by else self.name


def outline(verdicts: Iterable[Verdict]) -> list[DrawnSurface]:
    """Return the surfaces of one aircraft.

    A surface that is an actuator of its own has that actuator's condition, or its axis's where that is
    graver or its own says nothing. Names that are of no surface of a wing or a tail are left out; an axis
    that only such outputs move, or that fails and nothing is known to move, is shown where its surface
    usually is.
    """
    found: dict[str, tuple[Condition, str]] = {}
    titles: dict[str, str] = {}
    for verdict in verdicts:
        moved = verdict.surfaces if verdict.subject == "axis" else (verdict.actuator,)
        by = f"{verdict.actuator} control" if verdict.subject == "axis" else ""
        fails = SEVERITY[verdict.gravest] > SEVERITY["normal"]
        if by and not any(map(kind, moved)) and (moved or fails) and verdict.actuator in USUAL:
            usual = USUAL[verdict.actuator]
            own = [name.removesuffix(f" (moves with {verdict.actuator})") for name in moved]
            titles.setdefault(usual, join(own or ["outputs not known"]))
            moved = (usual,)
        for name in moved:
            if name != ALL and kind(name):
                one = verdict.gravest, by
                found[name] = max(found.get(name, one), one, key=lambda condition: _weight(condition[0]))
    shown = list(found)[:_MOST]
    return [
        _part(name, *found[name], place)._replace(name=titles.get(name, name))
        for name, place in zip(shown, places(shown), strict=True)
    ]


def multirotor(
    verdicts: Iterable[Verdict], outputs: Iterable[OutputUsage]
) -> tuple[list[DrawnSurface], tuple[str, ...]]:
    """Return a multirotor's motors, and its body; both are empty where no output is known to drive a motor.

    A motor without a verdict of its own, beside one that failed, is undecided.
    """
    motors = [(output.name or "", output.bearing_deg) for output in outputs if output.bearing_deg is not None]
    if not motors:
        return [], ()
    found = {verdict.actuator: verdict.gravest for verdict in verdicts if verdict.subject == "motor"}
    radius = _DISC.get(len(motors), _SMALL_DISC)
    x0, y0 = _HUB
    parts, arms = [], []
    for name, bearing in motors:
        turn = radians(bearing)
        x, y = x0 + _ARM * sin(turn), y0 - _ARM * cos(turn)
        wide, long = 4 * cos(turn), 4 * sin(turn)
        corners = ((x0 - wide, y0 - long), (x0 + wide, y0 + long), (x + wide, y + long), (x - wide, y - long))
        arms.append(" ".join(f"{a:.1f},{b:.1f}" for a, b in corners))
        points = (_polygon(x, y, radius),)
        parts.append(DrawnSurface(name, found.get(name, "undecided"), "", points, round(x, 1), round(y, 1)))
    nose = f"{x0},{y0 - 40} {x0 + 8},{y0 - 26} {x0 - 8},{y0 - 26}"
    return parts, (*arms, _polygon(x0, y0, 24.0), nose)


def _polygon(x: float, y: float, radius: float) -> str:
    turns = [2 * pi * k / _CORNERS for k in range(_CORNERS)]
    return " ".join(f"{x + radius * cos(turn):.1f},{y + radius * sin(turn):.1f}" for turn in turns)


def _weight(condition: Condition) -> int:
    """Return what outranks what on a drawing: nothing known yields to any answer."""
    return -1 if condition in ("unmonitored", "undecided") else URGENCY[condition]


def _part(name: str, condition: Condition, by: str, place: Place) -> DrawnSurface:
    """Return the drawing of a surface."""
    corners = _corners(place, fin="rudder" in kind(name) and kind(name) != V_TAIL)
    drawn = [(_MIDDLE[0] - _SCALE * y, _MIDDLE[1] - _SCALE * x) for x, y in corners]
    middle = [sum(axis) / len(drawn) for axis in zip(*drawn, strict=True)]
    mirrored = [(2 * _MIDDLE[0] - x, y) for x, y in drawn]
    sides = [drawn, mirrored] if place.mirrored else [drawn]
    points = tuple(" ".join(f"{x:.1f},{y:.1f}" for x, y in side) for side in sides)
    return DrawnSurface(name, condition, by, points, round(middle[0], 1), round(middle[1], 1))


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
