"""Friction in the power that a servo takes from its supply, where voltage and current are the bus's.

    P = V4·V5 = ρ·T² + w·T + P₀        T = T_c·sgn(w) + b·w + J·dw/dt + h·q·d + c

Mechanical power plus heat: no constant of the motor is needed. The friction is told as power per speed,
T_c·(1 + 2ρb), of the measured shaft.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.equations.own_current import rotor_speed
from mavhums.health.own.equation import OwnEquation, Speed
from mavhums.health.own.power import NAME
from mavhums.health.slots import Slots

__all__ = ["EQUATION"]

_V4, _V5, _V6 = column("V4"), column("V5"), column("V6")

Array = NDArray[np.float64]


def _power(actuator: Actuator, slots: Slots) -> Array:
    product = slots.values[:, _V4] * slots.values[:, _V5]
    power: Array = np.where(np.isfinite(product), product, slots.values[:, _V6])
    return power


def _speed(actuator: Actuator, slots: Slots) -> Speed | None:
    return rotor_speed(actuator, slots) if actuator.esc_side == "bus" else None


EQUATION = OwnEquation(
    name=NAME,
    fault="friction_power",
    quantity="friction in the supply's power",
    unit="N·m",
    inspect="gearbox, bearings, hinge line and motor",
    cause="friction, or a weaker or warmer motor: the power cannot tell which",
    min_rate_hz=20.0,
    min_flights=10,
    left=_power,
    speed=_speed,
)
