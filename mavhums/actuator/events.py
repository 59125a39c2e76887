"""Engine events about actuators: samples, and the profile in use. Times are flight times, s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Airframe

__all__ = ["AirframeNamed", "Samples"]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Quantities V1…V12 of one actuator: ``time_s`` of shape (n,), ``values`` of shape (n, 12).

    A quantity that the log does not carry is NaN.
    """

    vehicle: int
    actuator: str
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AirframeNamed:
    """The profile in use from here on for a vehicle (for all vehicles if None)."""

    time_s: float
    vehicle: int | None
    airframe: Airframe
