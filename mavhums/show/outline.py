"""The parts of an aircraft: whose condition each has, where it lies, and its outline from above."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from math import cos, pi, radians, sin
from typing import Final, NamedTuple

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.results.assessment import Assessment
from mavhums.results.sections import OutputUsage
from mavhums.results.verdict import ALL, Verdict


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


_UPRIGHT: Final = 90.0
V_TAIL: Final = "ruddervator|v.?tail"
_PLACES: Final[tuple[tuple[str, Place], ...]] = (
    (V_TAIL, Place(-0.86, 0.04, (0.06, 0.4), 0.12, 38.0)),
    ("rudder", Place(-0.86, 0.03, (0.05, 0.36), 0.13, _UPRIGHT)),
    ("elevator|stabil", Place(-0.86, 0.03, (0.04, 0.38), 0.12)),
    ("canard", Place(0.5, 0.02, (0.08, 0.34), 0.1)),
    ("spoiler|brake", Place(0.02, 0.05, (0.3, 0.62), 0.1)),
    ("flaperon|elevon|aileron", Place(-0.16, 0.03, (0.5, 0.98), 0.14)),
    ("flap", Place(-0.16, 0.03, (0.1, 0.48), 0.14)),
)
_ELSEWHERE: Final = Place(0.1, -0.3, (-0.6, 0.6), 0.1)
_WHOLE: Final = ("elevator|stabil", "canard")
_SIDED: Final = (V_TAIL, "spoiler|brake", "flaperon|elevon|aileron", "flap")
_USUAL: Final = {"roll": "aileron", "pitch": "elevator", "yaw": "rudder"}  # where no name says which
_SERVO: Final = re.compile(r"servo (\d+)")
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


class Part(NamedTuple):
    """A part of an aircraft: the text that says where it lies, and the verdict whose condition it has."""

    text: str
    verdict: Verdict


def surfaces(assessment: Assessment, vehicle: int | None) -> dict[str, Part]:
    """Return the surfaces of a vehicle by their names.

    A surface that is an actuator of its own has that actuator's condition, or its axis's where that is
    graver or its own says nothing. Outputs without the name of a surface are where the axis that they move
    usually has one, and so is an axis that fails and nothing is known to move.
    """
    outputs = outputs_of(assessment, vehicle)
    named = {str(one.servo): one.name for one in outputs if one.name and one.named_by == "profile"}
    found: dict[str, Part] = {}
    for verdict in (one for one in assessment.verdicts if one.vehicle == vehicle):
        usual = _USUAL.get(verdict.actuator, "") if verdict.subject == "axis" else ""
        moved = verdict.surfaces if verdict.subject == "axis" else (verdict.actuator,)
        if usual and not moved and SEVERITY[verdict.gravest] > SEVERITY["normal"]:
            moved = (f"{usual}, output not known",)
        for text in moved:
            servo = _SERVO.search(text)
            own = text.removesuffix(f" (moves with {verdict.actuator})")
            name = named.get(servo[1], own) if servo else own
            part = Part(text if kind(text) else f"{usual} {text}", verdict)
            graver = name not in found or _weight(found[name].verdict) < _weight(verdict)
            if text != ALL and kind(part.text) and graver:
                found[name] = part
    return found


def motors(assessment: Assessment, vehicle: int | None) -> dict[str, float]:
    """Return the motors of a multirotor by their names: the bearing of each, clockwise from the nose."""
    outputs = outputs_of(assessment, vehicle)
    return {one.name or "": one.bearing_deg for one in outputs if one.bearing_deg is not None}


def outputs_of(assessment: Assessment, vehicle: int | None) -> list[OutputUsage]:
    """Return the outputs of a vehicle."""
    return [one for used in assessment.usage if used.vehicle == vehicle for one in used.outputs]


def _weight(verdict: Verdict) -> int:
    """Return what outranks what on a drawing: nothing known yields to any answer."""
    unknown = verdict.gravest in ("unmonitored", "undecided")
    return -1 if unknown else URGENCY[verdict.gravest]


_SCALE: Final = 150.0
_MIDDLE: Final = (160.0, 130.0)
_FIN: Final = 0.05
_MOST: Final = 32
_HUB: Final = (160.0, 156.0)
_ARM: Final = 105.0
_DISC: Final = 42.0
_CORNERS: Final = 24
FIXED_WING: Final = (
    "160,14 170,34 171,220 166,276 154,276 149,220 150,34",
    "10,110 149,104 149,154 10,152",
    "310,110 171,104 171,154 310,152",
    "100,238 154,232 154,260 100,260",
    "220,238 166,232 166,260 220,260",
)
"""Fuselage, wings and tailplane, each by its corners."""


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


def outline(parts: Mapping[str, Part]) -> list[DrawnSurface]:
    """Return the surfaces of one aircraft as they are drawn; of very many the first ones."""
    shown = dict(islice(parts.items(), _MOST))
    lie = places([part.text for part in shown.values()])
    return [_drawn(name, part.verdict, place) for (name, part), place in zip(shown.items(), lie, strict=True)]


def multirotor(
    bearings_deg: Mapping[str, float], verdicts: Iterable[Verdict]
) -> tuple[list[DrawnSurface], tuple[str, ...]]:
    """Return a multirotor's motors, each with the condition of its verdict, and its body.

    A motor without a verdict of its own, beside one that failed, is undecided.
    """
    found = {verdict.actuator: verdict.gravest for verdict in verdicts if verdict.subject == "motor"}
    radius = min(_DISC, 0.75 * _ARM * sin(pi / len(bearings_deg)))  # the discs do not overlap
    x0, y0 = _HUB
    parts, arms = [], []
    for name, bearing in bearings_deg.items():
        turn = radians(bearing)
        x, y = x0 + _ARM * sin(turn), y0 - _ARM * cos(turn)
        wide, long = 4 * cos(turn), 4 * sin(turn)
        corners = ((x0 - wide, y0 - long), (x0 + wide, y0 + long), (x + wide, y + long), (x - wide, y - long))
        arms.append(_points(corners))
        disc = (_polygon(x, y, radius),)
        parts.append(DrawnSurface(name, found.get(name, "undecided"), "", disc, round(x, 1), round(y, 1)))
    nose = ((x0, y0 - 40), (x0 + 8, y0 - 26), (x0 - 8, y0 - 26))
    return parts, (*arms, _polygon(x0, y0, 24.0), _points(nose))


def _polygon(x: float, y: float, radius: float) -> str:
    turns = [2 * pi * k / _CORNERS for k in range(_CORNERS)]
    return _points((x + radius * cos(turn), y + radius * sin(turn)) for turn in turns)


def _points(corners: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)


def _drawn(name: str, verdict: Verdict, place: Place) -> DrawnSurface:
    """Return the drawing of a surface."""
    x0, y0 = _MIDDLE
    drawn = [(x0 - _SCALE * y, y0 - _SCALE * x) for x, y in _corners(place)]
    x, y = (round(sum(axis) / len(drawn), 1) for axis in zip(*drawn, strict=True))
    sides = [drawn, [(2 * x0 - x, y) for x, y in drawn]] if place.mirrored else [drawn]
    by = f"{verdict.actuator} control" if verdict.subject == "axis" else ""
    return DrawnSurface(name, verdict.gravest, by, tuple(map(_points, sides)), x, y)


def _corners(place: Place) -> Sequence[tuple[float, float]]:
    """Return the corners seen from above: x forward, y left."""
    begin, end = place.span
    front, back = place.x, place.x - place.chord
    flat = cos(radians(place.roll))
    begin, end = begin * flat, end * flat
    if place.roll == _UPRIGHT:
        front, back, begin, end = back, back - place.chord, -_FIN, _FIN
    return [(front, begin), (front, end), (back, end), (back, begin)]
