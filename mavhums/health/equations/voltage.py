"""The voltage equation of the stator winding, without inductance (paper, section 4).

    V4 = R·V5 + N·k_e·ω + offset

It holds moving or standing. In SI units the back-EMF constant k_e is the torque constant k_t.

Telemetry without signs shows the resistance where the shaft stands: |V4| = R·|V5|, whichever the signs are.
Their sign being unknown, these samples say nothing of the offset.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.least_squares import Prior
from mavhums.health.motion import Motion

__all__ = ["TERMS", "prior", "terms"]

TERMS = ("resistance", "back_emf", "offset")
_V4, _V5 = column("V4"), column("V5")
_STANDING = 0.2  # times the moving speed: an ESC's speed noise at standstill
_LOADED_A = 0.03  # three steps of ESC_TELEMETRY's current: less is noise, whose magnitude is no current
_RESISTANCE_DEVIATION = 0.2
_CONSTANT_DEVIATION = 0.1

Array = NDArray[np.float64]


def prior(actuator: Actuator) -> Prior:
    """Return a wide prior from the data sheet, because a fault may have changed the coefficients."""
    ema = actuator.known_ema()
    constant = ema.torque_constant * ema.gear_ratio
    return Prior(
        np.array([ema.resistance, constant, 0.0]),
        np.array([ema.resistance * _RESISTANCE_DEVIATION, constant * _CONSTANT_DEVIATION, np.inf]),
    )


def terms(actuator: Actuator, motion: Motion) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return terms (n, 3), left side (n,), V, and the mask of usable samples (n,)."""
    current, volts = motion.values[:, _V5], motion.values[:, _V4]
    X = np.stack([current, motion.speed, np.ones(len(volts))], axis=1)
    usable = np.isfinite(X).all(axis=1) & np.isfinite(volts)
    unsigned_v, unsigned_a, rev_min = motion.magnitudes.T
    stands = ~usable & (rev_min <= _STANDING * actuator.moving_speed_rev_min)
    stands &= unsigned_v > _LOADED_A * actuator.known_ema().resistance
    X[stands] = 0.0
    X[stands, 0] = unsigned_a[stands]
    return X, np.where(stands, unsigned_v, volts), usable | (stands & np.isfinite(unsigned_a))
