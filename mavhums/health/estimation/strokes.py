"""Strokes at constant commanded speed: what they show of a servo without any model of its motor.

A sweep of a surface before take-off, or of a bench, repeats the same motion. Each stroke at constant speed
shows

- roughness: the root mean square of the position error in its steady part, a cubic in time taken off. It
  names no cause: a worn sensor reads as rough, too;
- ripple: the same of the current;
- friction both ways: u = (I_out + I_back)/2 − I_0, the half-sum of the currents either way over that at
  rest, for a current without sign or with an offset, and no speed beside it; d = |I_back − I_out|/2 is the
  load.

The samples of a stroke are judged when it has ended, so that blocks do not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.quantities import column
from mavhums.health.estimation.equations import OWN_EQUATIONS, STROKE_EQUATIONS
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.equations.own_scale import RIPPLE, ROUGHNESS, TWO_WAYS
from mavhums.health.estimation.flight_sums import OwnSums
from mavhums.health.estimation.motor_identification import VoltageSums
from mavhums.health.estimation.slots import SENSED, Slots
from mavhums.health.estimation.thresholds import (
    LEAST_SAMPLES,
    LONGEST_STROKE_S,
    MOST_STROKES,
    MOVING_ANGLE_DEG_S,
    STROKE_BEGIN_S,
    STROKE_SPAN_S,
    STROKE_SPEED_SHARE,
)
from mavhums.results.verdict import OwnRecord

_V1, _V3, _V4, _V5, _V7, _V10 = (column(f"V{k}") for k in (1, 3, 4, 5, 7, 10))
_COLUMNS = 3  # command, measured angle, current


class Stroke(NamedTuple):
    """What one stroke shows; NaN where it is not measured.

    Attributes
    ----------
    way
        Its direction; 0 at rest.
    rough, ripple, current
        Roughness, °, ripple of the current and its median, A.
    commanded, reached
        Least and greatest angle, °, shape (2,), over the whole stroke.
    commanded_deg_s, reached_deg_s
        Speeds of its steady part.
    error
        Mean position error of its steady part, °.
    span_s, inner_s
        Its begin and end, and the times of its steady part.
    """

    way: float
    rough: float
    ripple: float
    current: float
    commanded: Array
    reached: Array
    commanded_deg_s: float
    reached_deg_s: float
    error: float
    span_s: Array
    inner_s: Array


class Strokes:
    """Collects the strokes of one actuator, the first ``MOST_STROKES`` of a flight.

    Parameters
    ----------
    actuator
        The actuator of the flight.
    """

    def __init__(self, actuator: Actuator) -> None:
        self._motor_side = actuator.esc_side == "motor"
        self._time_s, self._values = np.empty(0), np.empty((0, _COLUMNS))
        self._rate = np.empty(0)  # of the stroke that has not ended
        self._strokes: list[Stroke] = []

    @property
    def strokes(self) -> list[Stroke]:
        """The strokes so far, that with which the log ends included."""
        last = self._stroke(slice(None), self._rate) if self._rate.size else None
        return [*self._strokes, *([last] if last else [])][:MOST_STROKES]

    def feed(self, slots: Slots) -> None:
        """Process the samples of several slots."""
        own, time_s = slots.values[slots.judged], slots.time_s[slots.judged]
        measured = own[:, SENSED] > 0
        angle = np.where(measured, own[:, _V3], np.nan)
        alone = np.isnan(own[:, [_V4, _V7, _V10]]).all(axis=1) & self._motor_side
        # With a voltage or a speed beside it, the equations of the current say more.
        current = np.where(alone, own[:, _V5], np.nan)
        known = np.isfinite(own[:, _V1])
        self._time_s = np.concatenate([self._time_s, time_s[known]])
        self._values = np.concatenate([self._values, np.stack([own[:, _V1], angle, current], axis=1)[known]])
        self._take()

    def _take(self) -> None:
        """Judge the strokes that have ended; keep the samples from the beginning of the latest one."""
        time_s, command = self._time_s, self._values[:, 0]
        ahead = np.searchsorted(time_s, time_s + STROKE_SPAN_S)
        ready = int(np.searchsorted(ahead, time_s.size))
        if ready < 2:
            return
        at = np.arange(ready)
        rate = (command[ahead[:ready]] - command[at]) / (time_s[ahead[:ready]] - time_s[at])
        least = np.maximum(np.abs(rate[1:]), np.abs(rate[:-1]))
        turns = np.abs(np.diff(rate)) > STROKE_SPEED_SHARE * np.maximum(least, MOVING_ANGLE_DEG_S)
        turns |= np.diff(time_s[:ready]) > STROKE_SPAN_S
        edges = [0, *(np.flatnonzero(turns) + 1).tolist()]
        for a, b in pairwise(edges):
            found = self._stroke(slice(a, int(ahead[b - 1]) + 1), rate[a:b])
            if found is not None and len(self._strokes) < MOST_STROKES:
                self._strokes.append(found)
        # What is longer than any stroke is one for no shorter a part of it.
        begin = max(edges[-1], int(np.searchsorted(time_s, time_s[-1] - 2.0 * LONGEST_STROKE_S)))
        self._time_s, self._values, self._rate = time_s[begin:], self._values[begin:], rate[begin:]

    def _stroke(self, part: slice, rate: Array) -> Stroke | None:
        mean = float(rate.mean())
        at_rest = bool(np.abs(rate).max() < STROKE_SPEED_SHARE * MOVING_ANGLE_DEG_S)
        steady = float(np.ptp(rate)) <= STROKE_SPEED_SHARE * abs(mean) and abs(mean) > MOVING_ANGLE_DEG_S
        time_s = self._time_s[part]
        if not (at_rest or steady) or time_s[-1] - time_s[0] > LONGEST_STROKE_S:
            return None
        inner = (time_s >= time_s[0] + STROKE_BEGIN_S) & (time_s <= time_s[-1] - STROKE_SPAN_S)
        if inner.sum() < LEAST_SAMPLES:
            return None
        command, angle, current = self._values[part].T
        steady_s, error = time_s[inner], (command - angle)[inner]
        return Stroke(
            way=0.0 if at_rest else float(np.sign(mean)),
            rough=_rough(steady_s, error),
            ripple=_rough(steady_s, current[inner]),
            current=float(np.median(current[inner])),
            commanded=np.array([command.min(), command.max()]),
            reached=np.array([angle.min(), angle.max()]),
            commanded_deg_s=mean,
            reached_deg_s=_slope(steady_s, angle[inner]),
            error=float(error.mean()),
            span_s=time_s[[0, -1]],
            inner_s=steady_s,
        )


class StrokeSums(Strokes):
    """Collects what the strokes of one flight show of one quantity.

    Parameters
    ----------
    equation
        One of those of strokes.
    actuator
        The actuator of the flight.
    """

    def __init__(self, equation: OwnEquation, actuator: Actuator) -> None:
        super().__init__(actuator)
        self._equation = equation

    @property
    def gap(self) -> None:
        """None: a flight without strokes is no reason for a verdict."""
        return

    def record(self) -> OwnRecord | None:
        """Return the record of the flight so far; None if no stroke shows the quantity."""
        strokes = self.strokes
        rows = self._rows(strokes)
        if not rows:
            return None
        span_s = sum(float(stroke.inner_s[-1] - stroke.inner_s[0]) for stroke in strokes)
        samples = sum(stroke.inner_s.size - 1 for stroke in strokes)
        return OwnRecord(
            equation=self._equation.name,
            setup="strokes at constant speed",
            rate_hz=float(f"{samples / span_s:.3g}"),
            duration_s=round(float(strokes[-1].span_s[1] - strokes[0].span_s[0]), 1),
            groups=tuple((1.0, float(f"{value:.6g}"), float(f"{load:.6g}")) for value, load in rows),
        )

    def _rows(self, strokes: Sequence[Stroke]) -> list[tuple[float, float]]:
        """Return quantity and load of each stroke, or of each pair of strokes."""
        if not strokes:
            return []
        way, rough, ripple, current = np.array([stroke[:4] for stroke in strokes]).T
        loads = pairs_of(strokes)
        load = float(np.median([d for _, d in loads])) if loads else 0.0
        rest = current[(way == 0.0) & np.isfinite(current)]
        if self._equation.name == TWO_WAYS.name:
            return [(u - float(np.median(rest)), d) for u, d in loads] if rest.size else []
        shown = {ROUGHNESS.name: rough, RIPPLE.name: ripple}[self._equation.name]
        usable: Flags = (way != 0.0) & np.isfinite(shown)
        return [(float(value), load) for value in shown[usable]]


def pairs_of(strokes: Sequence[Stroke]) -> list[tuple[float, float]]:
    """Return half-sum and half-difference of the currents of each stroke out and the next one back.

    The difference is that of the way of positive speed less the other: its sign is the load's direction.
    """
    moving = [one for one in strokes if one.way and np.isfinite(one.current)]
    pairs = [(a, b) for a, b in zip(moving[::2], moving[1::2], strict=False) if a.way != b.way]
    return [((a.current + b.current) / 2, a.way * (a.current - b.current) / 2) for a, b in pairs]


def _slope(time_s: Array, values: Array) -> float:
    """Return the slope of a line in time; NaN where a value is not known."""
    around = time_s - time_s.mean()
    return float(around @ values / (around @ around))


def _rough(time_s: Array, values: Array) -> float:
    """Return the root mean square of values less a cubic in time; NaN where a value is not known."""
    if not np.isfinite(values).all():
        return np.nan
    scaled = np.polynomial.Polynomial.fit(time_s, values, 3)
    left: Array = values - scaled(time_s)
    return float(np.sqrt((left**2).sum() / (time_s.size - 4)))


def collectors(actuator: Actuator) -> list[OwnSums | VoltageSums | StrokeSums]:
    """Return the collectors of one flight of what is compared with the own earlier flights."""
    sums = [OwnSums(equation, actuator) for equation in OWN_EQUATIONS]
    return [*sums, VoltageSums(actuator), *(StrokeSums(one, actuator) for one in STROKE_EQUATIONS)]
