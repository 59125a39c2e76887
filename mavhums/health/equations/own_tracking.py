"""Position error in motion, for servos that measure only command and angle.

    V1 - V3 = e·sgn(w) + b·w + J·dw/dt + h·q·d + o

A proportional controller has a position error that grows with friction; play and a warm or worn winding
have the same effect, and integral action hides all of them. A change is therefore reported as a change of
tracking, without a cause.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.own.equation import OwnEquation, Speed
from mavhums.health.slots import SENSED, Slots

__all__ = ["EQUATION"]

_V1, _V3 = column("V1"), column("V3")
_MOVING_DEG_S = 2.5  # an angle's noise of 0.02° is 0.7 °/s between neighbours at 50 Hz

Array = NDArray[np.float64]


def _error(actuator: Actuator, slots: Slots) -> Array:
    measured = slots.values[:, SENSED] > 0
    error: Array = np.where(measured, slots.values[:, _V1] - slots.values[:, _V3], np.nan)
    return error


def _speed(actuator: Actuator, slots: Slots) -> Speed:
    angle, time_s = np.radians(slots.values[:, _V3]), slots.time_s
    speed = np.full(angle.size, np.nan)
    speed[1:-1] = (angle[2:] - angle[:-2]) / (time_s[2:] - time_s[:-2])
    return Speed(speed, np.radians(_MOVING_DEG_S))


EQUATION = OwnEquation(
    name="own_tracking",
    fault="tracking",
    quantity="tracking error in motion",
    unit="°",
    inspect="gearbox, linkage and motor, and whether the servo's settings were changed",
    cause="friction, play or winding: the log cannot tell which",
    min_rate_hz=20.0,
    min_flights=20,
    left=_error,
    speed=_speed,
    by_activity=True,
    blurs=True,  # a servo without power or torque falls behind by whole degrees, now more and now less
)
