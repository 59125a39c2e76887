"""Backlash and wind-up of the gear, from measured angles of rotor and output shaft.

    V3 - V2/N = -β/2·sgn(T) - T/k - f·sgn(ω) + bias

T is the load V11, β the backlash, k the stiffness; f is the wind-up by the friction of the output bearings,
between zero and the wind-up by the whole normal friction. With a small load that assists the motion the teeth
may be on either flank; with a load that opposes it the flank is certain.
"""

from __future__ import annotations

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.quantities import column
from mavhums.core.statistics import uniform_deviation
from mavhums.health.estimation.equations.interface import Equation
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.thresholds import MOST_TWIST_PER_STIFFNESS

_V2, _V3, _V11 = column("V2"), column("V3"), column("V11")


def _prior(actuator: Actuator) -> Prior:
    """Return the prior of backlash and wind-up: between zero and their largest plausible values.

    Backlash is at most twice its limit, half of it on either flank; wind-up by friction is at most that of
    the normal friction.
    """
    limits, stiffness = actuator.known_limits(), actuator.known_ema().stiffness
    flank = _up_to(-limits.backlash_deg if limits.backlash_deg else None)
    drag = _up_to(-np.degrees(limits.normal / stiffness) if stiffness else None)
    # Without a bound on the twist, grave play under a small load would read as twist.
    twist = _up_to(-MOST_TWIST_PER_STIFFNESS * np.degrees(1.0 / stiffness) if stiffness else None)
    known = (flank, twist, drag, _up_to(None))
    return Prior(np.array([mean for mean, _ in known]), np.array([deviation for _, deviation in known]))


def _up_to(most: float | None) -> tuple[float, float]:
    """Return mean and deviation for a value between zero and ``most``; None means unbounded."""
    return (0.0, np.inf) if most is None else (most / 2, uniform_deviation(abs(most)))


def _rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 4), left side (n,), °, and the mask of usable samples (n,)."""
    values, load = motion.values, motion.values[:, _V11]
    angle = values[:, _V3] - values[:, _V2] / actuator.known_ema().gear_ratio
    X = np.stack([np.sign(load), load, np.sign(motion.speed), np.ones(len(load))], axis=1)
    # The flank is certain under a load that friction cannot hold up, or that opposes the motion.
    flank = (np.abs(load) > actuator.known_limits().normal) | (load * motion.speed > 0)
    return X, angle, motion.moving & motion.apart & flank & np.isfinite(angle)


GEAR = Equation("gear", ("flank", "twist", "drag", "bias"), _prior, _rows)
