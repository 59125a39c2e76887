"""The supply voltage of the actuator, a constant, for an ESC that measures at the bus."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.least_squares import Prior
from mavhums.health.motion import Motion

__all__ = ["TERMS", "prior", "terms"]

TERMS = ("voltage",)

Array = NDArray[np.float64]


def prior(actuator: Actuator) -> Prior:
    """Return an uninformative prior."""
    return Prior(np.zeros(1), np.full(1, np.inf))


def terms(actuator: Actuator, motion: Motion) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return terms (n, 1), left side (n,), V, and the mask of usable samples (n,)."""
    return np.ones((len(motion.bus_v), 1)), motion.bus_v, np.isfinite(motion.bus_v)
