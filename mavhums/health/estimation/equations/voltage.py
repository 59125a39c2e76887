"""The voltage equation of the stator winding, without inductance (paper, section 4), and the supply.

    V4 = R·V5 + N·k_e·ω + offset

It holds moving or standing. In SI units the back-EMF constant k_e is the torque constant k_t.

Telemetry without signs shows the resistance where the shaft stands: |V4| = R·|V5|, whichever the signs are.
Their sign being unknown, these samples say nothing of the offset.

The voltage of the supply is a constant, for an ESC that measures at the bus.
"""

from __future__ import annotations

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.quantities import column
from mavhums.health.estimation.equations.interface import Equation
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.thresholds import (
    BACK_EMF_PRIOR_SHARE,
    LOADED_AT_STANDSTILL_A,
    RESISTANCE_PRIOR_SHARE,
    STANDSTILL_MOVING_SPEEDS,
)

_V4, _V5 = column("V4"), column("V5")


def _prior(actuator: Actuator) -> Prior:
    """Return a wide prior from the data sheet, because a fault may have changed the coefficients."""
    ema = actuator.known_ema()
    constant = ema.torque_constant * ema.gear_ratio
    return Prior(
        np.array([ema.resistance, constant, 0.0]),
        np.array([ema.resistance * RESISTANCE_PRIOR_SHARE, constant * BACK_EMF_PRIOR_SHARE, np.inf]),
    )


def _rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 3), left side (n,), V, and the mask of usable samples (n,)."""
    current, volts = motion.values[:, _V5], motion.values[:, _V4]
    X = np.stack([current, motion.speed, np.ones(len(volts))], axis=1)
    usable = np.isfinite(X).all(axis=1) & np.isfinite(volts)
    unsigned_v, unsigned_a, rev_min = motion.magnitudes.T
    stands = ~usable & (rev_min <= STANDSTILL_MOVING_SPEEDS * actuator.moving_speed_rev_min)
    # The magnitude of a small current is noise, which would read as resistance.
    stands &= unsigned_v > LOADED_AT_STANDSTILL_A * actuator.known_ema().resistance
    X[stands] = 0.0
    X[stands, 0] = unsigned_a[stands]
    return X, np.where(stands, unsigned_v, volts), usable | (stands & np.isfinite(unsigned_a))


def _uninformative(actuator: Actuator) -> Prior:
    return Prior(np.zeros(1), np.full(1, np.inf))


def _supply_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 1), left side (n,), V, and the mask of usable samples (n,)."""
    return np.ones((len(motion.bus_v), 1)), motion.bus_v, np.isfinite(motion.bus_v)


VOLTAGE = Equation("voltage", ("resistance", "back_emf", "offset"), _prior, _rows)
SUPPLY = Equation("supply", ("voltage",), _uninformative, _supply_rows)
