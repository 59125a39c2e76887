"""The terms of an own-scale equation at each sample."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.motion import lasting
from mavhums.health.own.equation import OwnEquation
from mavhums.health.slots import AIRSPEED, SENSED, SHAFT, Slots

__all__ = ["LOAD", "ONE", "PRESSURE", "TERMS", "Terms", "Turned", "terms"]

TERMS = ("sign", "speed", "acceleration", "load", "angle", "pressure", "one")
LOAD, ANGLE, PRESSURE, ONE = 3, 4, 5, 6
_V7, _V10 = column("V7"), column("V10")
_HALF_DENSITY = 0.5 * 1.225
_LONGEST_STEP_S = 0.5
_PERIODS = 2.5

Array = NDArray[np.float64]


class Terms(NamedTuple):
    """Terms of the judged samples.

    Attributes
    ----------
    X, y, usable
        Shapes (n, 7), (n,) and (n,).
    """

    X: Array
    y: Array
    usable: NDArray[np.bool_]


class Turned:
    """The angle of a servo, measured or integrated from its speed, block after block.

    The command is not used as the angle: its lag, times load, would appear as drag. An integrated angle has
    an unknown zero, which a free term of the pressure absorbs in each window.

    Attributes
    ----------
    source
        ``V3``, or ``speed`` where it is integrated; decided by the first slot that has either.
    """

    def __init__(self) -> None:
        self.source: str | None = None
        self._shaft: str | None = None
        self._time_s, self._rad_s, self._angle = np.nan, 0.0, 0.0

    def one_shaft(self, slots: Slots) -> Slots:
        """Return the slots with the speed of one shaft only: the rotor's if the first slot has it."""
        rotor, output = (np.isfinite(slots.values[slots.judged, key]) for key in (_V7, _V10))
        self._shaft = self._shaft or _first(slots.start, V7=rotor, V10=output)
        values = slots.values.copy()
        values[:, _V7 if self._shaft == "V10" else _V10] = np.nan
        return replace(slots, values=values)

    def feed(self, slots: Slots, rad_s: Array) -> Array:
        """Return the angle, rad, shape (n,): the output shaft's, or that of the shaft whose speed it is."""
        time_s, values = slots.time_s[slots.judged], slots.values[slots.judged]
        shaft_deg = values[:, SHAFT]
        measured = np.isfinite(shaft_deg) & (values[:, SENSED] > 0)
        self.source = self.source or _first(slots.start, V3=measured, speed=np.isfinite(rad_s))
        if self.source == "V3":
            return np.where(measured, np.radians(shaft_deg), np.nan)
        speed = np.nan_to_num(rad_s)
        before_s = time_s[0] if np.isnan(self._time_s) else self._time_s
        step_s = np.clip(np.diff(time_s, prepend=before_s), 0.0, _LONGEST_STEP_S)
        around = (speed + np.concatenate([[self._rad_s], speed[:-1]])) / 2
        angle: Array = np.concatenate([[self._angle], step_s * around]).cumsum()[1:]
        self._time_s, self._rad_s, self._angle = float(time_s[-1]), float(speed[-1]), float(angle[-1])
        return angle


def _first(start: NDArray[np.int64], **known: NDArray[np.bool_]) -> str | None:
    """Return which is known in the first slot that knows any of them, the earlier one if it knows several."""
    there = {name: np.logical_or.reduceat(mask, start) for name, mask in known.items()}
    slots = np.flatnonzero(np.logical_or.reduce([*there.values()]))
    return next(name for name, mask in there.items() if mask[slots[0]]) if slots.size else None


def terms(equation: OwnEquation, actuator: Actuator, slots: Slots, turned: Turned) -> Terms | None:
    """Return the terms at the samples that the slots judge; None if the profile rules the equation out."""
    slots = turned.one_shaft(slots)
    speed = equation.speed(actuator, slots)
    if speed is None:
        return None
    own, time_s = slots.judged, slots.time_s
    span = np.full(time_s.size, np.nan)
    acceleration = span.copy()
    span[1:-1] = time_s[2:] - time_s[:-2]
    acceleration[1:-1] = (speed.rad_s[2:] - speed.rad_s[:-2]) / span[1:-1]
    longest_s = 1.0 / equation.min_rate_hz
    moving = lasting(time_s, speed.rad_s, speed.moving_rad_s, _PERIODS * longest_s)
    moving &= span < 2 * _PERIODS * longest_s
    values = slots.values
    angle = turned.feed(slots, speed.rad_s[own])
    pressure = _HALF_DENSITY * np.nan_to_num(values[own, AIRSPEED]) ** 2
    X = np.empty((angle.size, len(TERMS)))
    X[:, 0] = np.sign(speed.rad_s[own])
    X[:, 1] = speed.rad_s[own]
    X[:, 2] = acceleration[own]
    X[:, LOAD] = pressure * angle
    X[:, ANGLE] = angle
    X[:, PRESSURE] = pressure
    X[:, ONE] = 1.0
    y = np.ascontiguousarray(equation.left(actuator, slots)[own])
    usable = moving[own] & np.isfinite(y) & np.isfinite(X).all(axis=1)
    return Terms(X, y, usable)
