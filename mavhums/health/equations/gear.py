"""What the gear takes up between rotor and output shaft, both of whose angles are measured.

    V3 - V2/N = -β/2·sgn(T) - T/k - f·sgn(ω) + bias

T is the load V11, β the backlash, k the stiffness; f is the wind-up by the output bearings' friction. A
small load may leave the teeth on either flank, so only loads beyond the normal friction count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.least_squares import Prior
from mavhums.health.motion import Motion
from mavhums.quantities import column

__all__ = ["TERMS", "prior", "terms"]

TERMS = ("flank", "twist", "drag", "bias")
_V2, _V3, _V11 = column("V2"), column("V3"), column("V11")

Array = NDArray[np.float64]


def prior(actuator: Actuator) -> Prior:
    """Return that nothing is known of the coefficients."""
    return Prior(np.zeros(len(TERMS)), np.full(len(TERMS), np.inf))


def terms(actuator: Actuator, motion: Motion) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return terms (n, 4), left side (n,), °, and which samples can be used."""
    values, load = motion.values, motion.values[:, _V11]
    angle = values[:, _V3] - values[:, _V2] / actuator.known_ema().gear_ratio
    X = np.stack([np.sign(load), load, np.sign(motion.speed), np.ones(len(load))], axis=1)
    loaded = np.abs(load) > actuator.known_limits().normal
    return X, angle, motion.moving & motion.apart & loaded & np.isfinite(angle)
