"""The interface of detectors: one fault, the quantity that indicates it, and its limits.

A detector is a module in :mod:`mavhums.health.detectors` with a class named ``Detector``; it is discovered
automatically. Every detector passes the same battery of checks, ``tests/health/test_detectors.py``.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.least_squares import Fit
from mavhums.health.motion import Motion
from mavhums.health.own.registry import inspected
from mavhums.health.slots import Slots

__all__ = [
    "Detector",
    "EquationDetector",
    "Estimates",
    "Levels",
    "Seen",
    "detectors_for",
    "sharp",
    "to_inspect",
]

Array = NDArray[np.float64]


class Levels(NamedTuple):
    """The quantity's upper limit for normal and lower limit for an emergency; None if there is none."""

    normal: float | None = None
    emergency: float | None = None


class Estimates(NamedTuple):
    """Estimates of a quantity in k windows; arrays of shape (k,), NaN for windows without evidence.

    Attributes
    ----------
    value, error
        Estimate and standard error.
    freedom
        Degrees of freedom of the error.
    """

    value: Array
    error: Array
    freedom: Array

    @classmethod
    def of(cls, value: Array, error: Array, freedom: Array, shown: NDArray[np.bool_]) -> Estimates:
        """Return estimates that are NaN where they are not shown."""
        return cls(np.where(shown, value, np.nan), error, freedom)

    def at(self, which: NDArray[np.bool_] | int) -> Estimates:
        """Return a subset of the windows, or one quantity of estimates of shape (d, k)."""
        return Estimates(*(array[which] for array in self))


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
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


class Detector(Protocol):
    """Detects one fault of one actuator.

    Attributes
    ----------
    fault, quantity, unit
        The fault, and the quantity that indicates it.
    equations
        Names of the equations in :mod:`mavhums.health.equations` that it reads.
    two_sided
        Whether the quantity is normal near zero and not below a value.
    span_s
        Time through which a fault lasts that a single estimate proves; None if several must agree.
    levels
        Limits of the quantity.
    inspect
        The parts that maintenance should inspect.
    """

    fault: ClassVar[str]
    quantity: ClassVar[str]
    unit: ClassVar[str]
    inspect: ClassVar[str]
    equations: ClassVar[tuple[str, ...]]
    two_sided: ClassVar[bool]
    span_s: ClassVar[float | None]
    levels: Levels

    def __init__(self, actuator: Actuator) -> None:
        """Create the detector for this actuator."""
        ...

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile has the data that the detector needs."""
        ...

    def feed(self, seen: Seen) -> Estimates:
        """Return the quantity in the windows that end with each new slot."""
        ...

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity over the whole flight, as one window; None if it is not defined."""
        ...

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity that judges a finished flight; None if only windows count."""
        ...


class EquationDetector:
    """A detector that reads its quantity from fits of equations, for windows and whole flights alike.

    Attributes
    ----------
    turned
        Whether the rotor's speed follows from the output shaft's, as the first known speed tells. The shaft's
        differs by what play and torsion of the gear let it move by itself.
    """

    equations: ClassVar[tuple[str, ...]]
    two_sided: ClassVar[bool] = False
    span_s: ClassVar[float | None] = None

    def __init__(self, actuator: Actuator) -> None:
        self.actuator = actuator
        self.turned: bool | None = None

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile has the actuator's constants."""
        return actuator.ema is not None

    def feed(self, seen: Seen) -> Estimates:
        """Return the quantity in the windows that end with each new slot."""
        if self.turned is None and seen.motion is not None and np.isfinite(seen.motion.speed).any():
            self.turned = bool(seen.motion.turned[np.isfinite(seen.motion.speed).argmax()])
        return self.read(seen.windows, seen.flight)

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity over the whole flight."""
        return self.read(flight, flight)

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity that judges a finished flight: the one over the whole flight."""
        return self.overall(flight)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the quantity from the fits, given the fits of the flight so far."""
        raise NotImplementedError


def sharp(value: Array, error: Array, widest: float, limit: float | None) -> NDArray[np.bool_]:
    """Return whether estimates are certain enough to count, shape (k,).

    ``widest`` is the largest standard error of a value within its limit. Beyond the limit the error may grow
    with the value: a grave fault blurs what it is measured by, and must not be refused for that.
    """
    size = np.abs(value) / (np.inf if limit is None else limit)
    allowed: NDArray[np.bool_] = error < widest * np.maximum(size, 1.0)
    return allowed


@cache
def _discovered() -> tuple[type[Detector], ...]:
    from mavhums.health.detectors import actuator as detectors

    names = sorted(module.name for module in pkgutil.iter_modules(detectors.__path__))
    modules = (importlib.import_module(f"{detectors.__name__}.{name}") for name in names)
    return tuple(module.Detector for module in modules)


def to_inspect(fault: str) -> str | None:
    """Return the parts to inspect for a fault; None if no detector covers it.

    Examples
    --------
    >>> to_inspect("backlash")
    'gear and linkage for play'
    """
    own = inspected(fault)
    return own or next((detector.inspect for detector in _discovered() if detector.fault == fault), None)


def detectors_for(actuator: Actuator) -> list[Detector]:
    """Return the detectors of all faults that are detectable with this actuator's profile.

    Examples
    --------
    >>> from mavhums.actuator import load_airframe
    >>> [detector.fault for detector in detectors_for(load_airframe("paper").actuators[0])][:3]
    ['backlash', 'following', 'friction']
    """
    return [detector(actuator) for detector in _discovered() if detector.suits(actuator)]
