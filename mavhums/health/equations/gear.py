"""What the gear takes up between rotor and output shaft, both of whose angles are measured.

    V3 - V2/N = -β/2·sgn(T) - T/k - f·sgn(ω) + bias

T is the load V11, β the backlash, k the stiffness; f is the wind-up by the output bearings' friction, from
nothing to that of all the normal friction. A small load that drives the motion may leave the teeth on
either flank; one that opposes it never does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.least_squares import Prior
from mavhums.health.motion import Motion
from mavhums.quantities import column

__all__ = ["BIAS", "FLANK", "LEAST_SLOTS", "TERMS", "prior", "terms"]

TERMS = ("flank", "twist", "drag", "bias")
FLANK, BIAS = 0, 3
LEAST_SLOTS = 3
"""In how many slots the load must press on either flank: fewer do not show how sure they are."""
_TWIST_DEG_PER_NM = 0.15  # of a gear of 400 N·m/rad
_V2, _V3, _V11 = column("V2"), column("V3"), column("V11")

Array = NDArray[np.float64]


def prior(actuator: Actuator) -> Prior:
    """Return what is known of flank and wind-up by friction: between nothing and what could be.

    Play reaches to twice its limit, either half of it to a flank; wind-up to that of the normal friction.
    """
    limits = actuator.known_limits()
    flank, drag = limits.backlash_deg or np.inf, _TWIST_DEG_PER_NM * limits.normal
    mean = np.array([0.0 if np.isinf(flank) else -flank / 2, 0.0, -drag / 2, 0.0])
    return Prior(mean, np.array([flank, np.inf, drag, np.inf]) / np.sqrt(12.0))


def terms(actuator: Actuator, motion: Motion) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return terms (n, 4), left side (n,), °, and which samples can be used."""
    values, load = motion.values, motion.values[:, _V11]
    angle = values[:, _V3] - values[:, _V2] / actuator.known_ema().gear_ratio
    X = np.stack([np.sign(load), load, np.sign(motion.speed), np.ones(len(load))], axis=1)
    flank = (np.abs(load) > actuator.known_limits().normal) | (load * motion.speed > 0)
    return X, angle, motion.moving & motion.apart & flank & np.isfinite(angle)
