"""The terms of an own-scale equation at each sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.motion import lasting
from mavhums.health.own.equation import OwnEquation
from mavhums.health.slots import AIRSPEED, SENSED, SHAFT, Slots

__all__ = ["LOAD", "ONE", "PRESSURE", "TERMS", "Terms", "Turned", "terms"]

TERMS = ("sign", "speed", "acceleration", "load", "angle", "pressure", "one")
LOAD, ANGLE, PRESSURE, ONE = 3, 4, 5, 6
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
        ``V3``, or ``speed`` where it is integrated; decided by the first samples that have either.
    """

    def __init__(self) -> None:
        self.source: str | None = None
        self._time_s, self._rad_s, self._angle = np.nan, 0.0, 0.0

    def feed(self, time_s: Array, rad_s: Array, shaft_deg: Array, sensed: Array) -> Array:
        """Return the angle, rad, shape (n,): the output shaft's, or that of the shaft whose speed it is."""
        measured = np.isfinite(shaft_deg) & (sensed > 0)
        if self.source is None and (measured.any() or np.isfinite(rad_s).any()):
            self.source = "V3" if measured.any() else "speed"
        if self.source == "V3":
            return np.where(measured, np.radians(shaft_deg), np.nan)
        speed = np.nan_to_num(rad_s)
        before_s = time_s[0] if np.isnan(self._time_s) else self._time_s
        step_s = np.clip(np.diff(time_s, prepend=before_s), 0.0, _LONGEST_STEP_S)
        around = (speed + np.concatenate([[self._rad_s], speed[:-1]])) / 2
        angle: Array = np.concatenate([[self._angle], step_s * around]).cumsum()[1:]
        self._time_s, self._rad_s, self._angle = float(time_s[-1]), float(speed[-1]), float(angle[-1])
        return angle


def terms(equation: OwnEquation, actuator: Actuator, slots: Slots, turned: Turned) -> Terms | None:
    """Return the terms at the samples that the slots judge; None if the profile rules the equation out."""
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
    angle = turned.feed(time_s[own], speed.rad_s[own], values[own, SHAFT], values[own, SENSED])
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
