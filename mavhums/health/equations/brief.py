"""The torque balance of single samples in motion, for motion too brief for neighbouring samples.

    N·k_t·V5 - V11 - b·ω = T_c·sgn(ω) + offset + c·V3

An autopilot's small corrections last a tenth of a second: at 20 Hz and below, hardly any sample has
neighbours in the same motion. The balance omits the gear play after a reversal, where only a part of the
friction acts, and the inertial torque, which needs two neighbours. Both are small in the mean over a
flight, but not in one window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.least_squares import Prior
from mavhums.health.motion import Motion

__all__ = ["TERMS", "prior", "terms"]

TERMS = ("friction", "offset", "hinge")
_CERTAIN = 3.0  # times the moving speed: slower ones may be sensor noise or have a wrong derived sign
_V1, _V3, _V5, _V8, _V11 = (column(key) for key in ("V1", "V3", "V5", "V8", "V11"))

Array = NDArray[np.float64]


def prior(actuator: Actuator) -> Prior:
    """Return an uninformative prior."""
    return Prior(np.zeros(len(TERMS)), np.full(len(TERMS), np.inf))


def terms(actuator: Actuator, motion: Motion) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return terms (n, 3), left side (n,), N·m, and the mask of usable samples (n,)."""
    values, ema = motion.values, actuator.known_ema()
    current = values[:, _V5] * ema.torque_constant
    torque = np.where(np.isfinite(current), current, values[:, _V8]) * ema.gear_ratio
    load = values[:, _V11]
    angle = np.where(np.isfinite(values[:, _V3]), values[:, _V3], values[:, _V1])
    deflection = np.where(np.isfinite(load), 0.0, np.radians(angle))
    X = np.stack([np.sign(motion.speed), np.ones(len(load)), deflection], axis=1)
    y = torque - np.where(np.isfinite(load), load, 0.0) - ema.viscous * motion.speed
    fast = np.abs(motion.speed) > _CERTAIN * np.radians(actuator.moving_speed_deg_s)
    return X, y, fast & np.isfinite(y) & np.isfinite(deflection)
