"""Friction in units of the motor's current, from V5 and V7 or V10: no constant of the servo is needed.

V5 = I_c·sgn(w) + b·w + J·dw/dt + h·q·d + o        I_c = T_c/(N·k_t), A
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.own.equation import OwnEquation, Speed
from mavhums.health.slots import Slots

__all__ = ["EQUATION", "rotor_speed"]

_V5, _V7, _V10 = column("V5"), column("V7"), column("V10")
_RAD_S = np.pi / 30
_MOVING_REV_MIN = 50.0  # of a rotor whose gear is not known

Array = NDArray[np.float64]


def rotor_speed(actuator: Actuator, slots: Slots) -> Speed:
    """Return the rotor's speed, or the output shaft's where only that is measured."""
    rotor, output = slots.values[:, _V7], slots.values[:, _V10]
    if np.isfinite(output).any() and not np.isfinite(rotor).any():
        return Speed(output * _RAD_S, float(np.radians(actuator.moving_speed_deg_s)))
    moving = _MOVING_REV_MIN if actuator.ema is None else actuator.moving_speed_rev_min
    return Speed(rotor * _RAD_S, moving * _RAD_S)


def _current(actuator: Actuator, slots: Slots) -> Array:
    current: Array = slots.values[:, _V5]
    return np.full(current.shape, np.nan) if actuator.esc_side == "bus" else current


EQUATION = OwnEquation(
    name="own_current",
    fault="friction_current",
    quantity="friction current",
    unit="A",
    inspect="gearbox, bearings and hinge line",
    cause="friction",
    min_rate_hz=20.0,
    min_flights=10,
    left=_current,
    speed=rotor_speed,
)
