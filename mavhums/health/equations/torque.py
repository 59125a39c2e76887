"""The torque balance at the moving output shaft (paper, section 4).

    N·k_t·V5 - V11 = T_c·sgn(ω) + N²J·dω/dt + offset + b·ω + c·V3

The left side is measured; k_t is from the data sheet. If V11 is not measured, the hinge moment is
assumed proportional to the deflection. The inertia and the viscous drag b have priors: with stepwise
commands too few samples contain the acceleration to fit it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.least_squares import Prior
from mavhums.health.motion import Motion

__all__ = ["TERMS", "prior", "terms"]

TERMS = ("friction", "inertia", "offset", "viscous", "hinge")
_V1, _V3, _V5, _V8, _V11 = (column(key) for key in ("V1", "V3", "V5", "V8", "V11"))

Array = NDArray[np.float64]


def prior(actuator: Actuator) -> Prior:
    """Return the prior of the coefficients from the data sheet."""
    ema = actuator.known_ema()
    inertia = actuator.inertia_output
    unknown = np.inf
    return Prior(
        np.array([0.0, inertia, 0.0, ema.viscous, 0.0]),
        np.array(
            [unknown, inertia * ema.inertia_uncertainty / 2, unknown, ema.viscous_uncertainty / 2, unknown]
        ),
    )


def terms(actuator: Actuator, motion: Motion) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return terms (n, 5), left side (n,), N·m, and the mask of usable samples (n,)."""
    values, ema = motion.values, actuator.known_ema()
    current = values[:, _V5] * ema.torque_constant
    torque = np.where(np.isfinite(current), current, values[:, _V8]) * ema.gear_ratio
    load = values[:, _V11]
    loaded = np.isfinite(load)
    angle = np.where(np.isfinite(values[:, _V3]), values[:, _V3], values[:, _V1])
    X = np.empty((len(torque), len(TERMS)))
    X[:, 0] = np.sign(motion.speed)
    X[:, 1] = motion.acceleration
    X[:, 2] = 1.0
    X[:, 3] = motion.speed_around
    X[:, 4] = np.where(loaded, 0.0, np.radians(angle))
    y = np.where(loaded, torque - load, torque)
    return X, y, motion.moving & np.isfinite(y) & np.isfinite(X[:, 4])
