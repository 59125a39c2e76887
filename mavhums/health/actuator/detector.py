"""The interface of detectors: one fault, the quantity that indicates it, and its limits.

A detector is a class in :mod:`mavhums.health.actuator.detectors`, listed in its ``DETECTORS``. Every
detector passes the same battery of checks, ``tests/health/actuator/test_detectors.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.health.actuator.thresholds import WIDEST_ERROR_SHARE
from mavhums.health.decision.limits import Estimates, Levels
from mavhums.health.estimation.least_squares import Fit
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import Slots


@dataclass(frozen=True, slots=True, eq=False)
class DetectorInput:
    """Data of new slots of an actuator, the input of detectors.

    Attributes
    ----------
    slots
        The samples.
    motion
        Motion at the samples; None if the profile lacks the constants for it.
    windows, flight
        By equation, the fits of the windows that end with each slot, and of all slots so far.
    """

    slots: Slots
    motion: Motion | None
    windows: Mapping[str, Fit]
    flight: Mapping[str, Fit]


class Detector:
    """Detects one fault of one actuator.

    Its quantity judges single windows and has no mean over a flight, unless a subclass says otherwise.

    Attributes
    ----------
    fault, quantity, unit
        The fault, and the quantity that indicates it.
    inspect
        The parts that maintenance should inspect.
    equations
        Names of the equations in :mod:`mavhums.health.estimation.equations` that it reads.
    two_sided
        Whether the quantity is normal near zero and not below a value.
    span_s
        Time through which a fault lasts that a single estimate proves; None if several must agree.
    levels
        Limits of the quantity.
    """

    fault: ClassVar[str]
    quantity: ClassVar[str]
    unit: ClassVar[str]
    inspect: ClassVar[str]
    equations: ClassVar[tuple[str, ...]] = ()
    two_sided: ClassVar[bool] = False
    span_s: ClassVar[float | None] = None
    levels: Levels

    def __init__(self, actuator: Actuator) -> None:
        self.actuator = actuator

    @classmethod
    def suits(cls, actuator: Actuator) -> bool:
        """Return whether the profile has the data that the detector needs."""
        return True

    def feed(self, seen: DetectorInput) -> Estimates:
        """Return the quantity in the windows that end with each new slot."""
        raise NotImplementedError

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity over the whole flight, as one window; None if it is not defined."""
        return None

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity that judges a finished flight; None if only windows count."""
        return self.overall(flight)


class EquationDetector(Detector):
    """A detector that reads its quantity from fits of equations, for windows and whole flights alike.

    Attributes
    ----------
    needs_limits
        Whether it needs the profile's limits beside the actuator's constants.
    turned
        Whether the rotor's speed follows from the output shaft's, as the first known speed shows. The shaft's
        differs by what play and torsion of the gear let it move by itself.
    """

    needs_limits: ClassVar[bool] = False

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.turned: bool | None = None

    @classmethod
    def suits(cls, actuator: Actuator) -> bool:
        """Return whether the profile has the actuator's constants, and limits where they are needed."""
        return not actuator.blanks if cls.needs_limits else actuator.ema is not None

    def feed(self, seen: DetectorInput) -> Estimates:
        """Return the quantity in the windows that end with each new slot."""
        if self.turned is None and seen.motion is not None and np.isfinite(seen.motion.speed).any():
            # Decided once: samples of both kinds would mix two errors.
            self.turned = bool(seen.motion.turned[np.isfinite(seen.motion.speed).argmax()])
        return self.read(seen.windows, seen.flight)

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity over the whole flight."""
        return self.read(flight, flight)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the quantity from the fits, given the fits of the flight so far."""
        raise NotImplementedError


def sharp(value: Array, error: Array, limit: float | None, healthy: float = 0.0) -> Flags:
    """Return whether estimates are certain enough to count, shape (k,); all without a limit.

    Beyond the limit the error may grow with the value: a grave fault blurs what it is measured by, and must
    not be refused for that.
    """
    if limit is None:
        return np.isfinite(error)
    widest = WIDEST_ERROR_SHARE * (limit - healthy)
    allowed: Flags = error < widest * np.maximum(np.abs(value) / limit, 1.0)
    return allowed
