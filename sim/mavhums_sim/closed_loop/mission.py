"""Missions: legs drawn from the seed, from take-off to approach."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, pi, sin
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim.closed_loop.autopilot import CLIMB, HEADING, LOITER, STICKS, TRACK

PHASES = ("climb", "cruise", "turns", "heading", "manual", "approach")

LEG = np.dtype(
    [
        ("kind", "i8"),
        ("phase", "i8"),
        ("north0", "f8"),
        ("east0", "f8"),
        ("north", "f8"),
        ("east", "f8"),
        ("height", "f8"),
        ("speed", "f8"),
        ("radius", "f8"),
        ("heading", "f8"),
        ("lasts", "f8"),
    ]
)

Mission = Literal["mixed", "waypoints", "loiter", "heading", "manual"]
_BASE_M = 120.0
_LANDS_S = 300.0  # a shorter flight does not land


@dataclass(slots=True)
class _Plan:
    """A sequence of legs; ``spent`` is their approximate duration, s."""

    rng: np.random.Generator
    rows: list[tuple[float, ...]]
    at: tuple[float, float] = (0.0, 0.0)
    height: float = _BASE_M
    spent: float = 0.0

    def add(
        self, kind: int, phase: str, *, lasts: float = 0.0, radius: float = 0.0, heading: float = 0.0
    ) -> None:
        speed = float(self.rng.uniform(22.0, 28.0))
        here = (*self.at, *self.at)
        self.rows.append((kind, PHASES.index(phase), *here, self.height, speed, radius, heading, lasts))
        self.spent += lasts

    def fly_to(self, north: float, east: float, phase: str = "cruise") -> None:
        distance = hypot(north - self.at[0], east - self.at[1])
        speed = float(self.rng.uniform(22.0, 28.0))
        leg = (*self.at, north, east, self.height, speed, 0.0, 0.0, distance / speed + 20.0)
        self.rows.append((TRACK, PHASES.index(phase), *leg))
        self.at = (north, east)
        self.spent += distance / speed

    def change_height(self) -> None:
        self.height = float(np.clip(self.height + self.rng.choice([-30.0, 0.0, 0.0, 30.0]), 80.0, 250.0))


def plan(seed: int, duration_s: float, mission: Mission = "mixed") -> NDArray[np.void]:
    """Return the legs of a flight, :data:`LEG` rows; they last longer than ``duration_s``.

    Parameters
    ----------
    mission
        ``mixed`` draws blocks of the others, and every third such flight ends in an approach.

    Examples
    --------
    >>> str(plan(1, 300.0, "loiter")["kind"][1])
    '2'
    """
    rng = np.random.default_rng([seed, 23])
    course = _Plan(rng, [])
    course.add(CLIMB, "climb", lasts=25.0, heading=float(rng.uniform(-pi, pi)))
    lands = mission == "mixed" and duration_s > _LANDS_S and rng.random() < 1.0 / 3.0
    air_time = duration_s - (160.0 if lands else -60.0)
    blocks = ("waypoints", "loiter", "heading", "manual") if mission == "mixed" else (mission,)
    while course.spent < air_time:
        _BLOCKS[str(rng.choice(blocks))](course)
        course.change_height()
    if lands:
        course.height = 40.0
        course.fly_to(0.0, 0.0, "approach")
        course.height = -30.0
        angle = float(rng.uniform(-pi, pi))
        course.fly_to(900.0 * cos(angle), 900.0 * sin(angle), "approach")
    return np.array(course.rows, dtype=LEG)


def sticks(seed: int, count: int) -> Array:
    """Return the pilot's roll and pitch demands at 50 Hz within ±1, shape (count, 2).

    The pilot moves the stick every 1…8 s; a movement takes about 0.3 s.
    """
    rng = np.random.default_rng([seed, 24])
    moves = np.cumsum(rng.uniform(1.0, 8.0, 2 + count // 50))
    roll = rng.choice([0.0, 0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9], moves.size) + 0.05 * rng.standard_normal(
        moves.size
    )
    pitch = 0.5 * rng.choice([0.0, 0.0, 1.0, -1.0], moves.size) + 0.1 * rng.standard_normal(moves.size)
    held = np.searchsorted(moves, np.arange(count) * 0.02)
    steps = np.stack([roll[held], pitch[held]], axis=1)
    kernel = np.ones(15) / 15.0
    return np.stack([np.convolve(column, kernel)[:count] for column in steps.T], axis=1)


def _waypoints(course: _Plan) -> None:
    """Fly a racetrack or some random points."""
    if course.rng.random() < 0.5:
        north, east = course.at
        angle, length = course.rng.uniform(-pi, pi), course.rng.uniform(300.0, 700.0)
        ahead = np.array([cos(angle), sin(angle)]) * length
        aside = np.array([-sin(angle), cos(angle)]) * course.rng.uniform(150.0, 250.0)
        corners = [ahead, ahead + aside, aside, np.zeros(2)]
        for corner in corners * 2:
            course.fly_to(north + float(corner[0]), east + float(corner[1]))
        return
    for _ in range(6):
        angle, reach = course.rng.uniform(-pi, pi), course.rng.uniform(100.0, 600.0)
        course.fly_to(reach * cos(angle), reach * sin(angle))
        course.change_height()


def _loiter(course: _Plan) -> None:
    radius = float(course.rng.uniform(70.0, 130.0) * course.rng.choice([-1.0, 1.0]))
    course.add(LOITER, "turns", lasts=float(course.rng.uniform(60.0, 120.0)), radius=radius)


def _heading(course: _Plan) -> None:
    for _ in range(3):
        lasts = float(course.rng.uniform(15.0, 35.0))
        course.add(HEADING, "heading", lasts=lasts, heading=float(course.rng.uniform(-pi, pi)))


def _manual(course: _Plan) -> None:
    course.add(STICKS, "manual", lasts=float(course.rng.uniform(60.0, 120.0)))


_BLOCKS = {"waypoints": _waypoints, "loiter": _loiter, "heading": _heading, "manual": _manual}
