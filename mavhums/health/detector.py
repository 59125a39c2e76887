"""What a detector is: one fault, the quantity that shows it, and the limits of that quantity.

A detector is one module in :mod:`mavhums.health.detectors` with a class named ``Detector``; it is found
there. Every detector passes the same battery of checks, ``tests/health/test_detectors.py``.
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

__all__ = ["Detector", "EquationDetector", "Estimates", "Levels", "Seen", "detectors_for", "to_inspect"]

Array = NDArray[np.float64]


class Levels(NamedTuple):
    """Values of the quantity up to which it is normal, and from which it is an emergency; None: never."""

    normal: float | None = None
    emergency: float | None = None


class Estimates(NamedTuple):
    """A quantity in k windows; arrays of shape (k,), NaN where a window cannot show it.

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
        """Return some of the windows, or of estimates of several quantities, shape (d, k), those of one."""
        return Estimates(*(array[which] for array in self))


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What some new slots show of an actuator.

    Attributes
    ----------
    slots
        The samples.
    motion
        How they move; None where the profile lacks the constants that tell.
    windows, flight
        By equation, the fits of the windows that end with each slot, and those of all slots so far.
    """

    slots: Slots
    motion: Motion | None
    windows: Mapping[str, Fit]
    flight: Mapping[str, Fit]


class Detector(Protocol):
    """Looks for one fault in one actuator.

    Attributes
    ----------
    fault, quantity, unit
        What it looks for, and what shows it.
    equations
        Of :mod:`mavhums.health.equations`, that it reads.
    two_sided
        Whether the quantity is normal near zero and not below a value.
    levels
        Limits of the quantity.
    inspect
        What the maintainer should inspect.
    """

    fault: ClassVar[str]
    quantity: ClassVar[str]
    unit: ClassVar[str]
    inspect: ClassVar[str]
    equations: ClassVar[tuple[str, ...]]
    two_sided: ClassVar[bool]
    levels: Levels

    def __init__(self, actuator: Actuator) -> None:
        """Look at this actuator."""
        ...

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile says enough of the actuator."""
        ...

    def feed(self, seen: Seen) -> Estimates:
        """Return the quantity in the windows that end with each new slot."""
        ...

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity over the whole flight, as one window; None if it has no such meaning."""
        ...

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity by which a finished flight may be judged; None if only its windows count."""
        ...


class EquationDetector:
    """A detector that reads its quantity from the fits of equations, of windows and of the flight alike."""

    equations: ClassVar[tuple[str, ...]]
    two_sided: ClassVar[bool] = False

    def __init__(self, actuator: Actuator) -> None:
        self.actuator = actuator

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile has the actuator's constants."""
        return actuator.ema is not None

    def feed(self, seen: Seen) -> Estimates:
        """Return the quantity in the windows that end with each new slot."""
        return self.read(seen.windows, seen.flight)

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity over the whole flight."""
        return self.read(flight, flight)

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates | None:
        """Return the quantity by which a finished flight may be judged: that of all of it."""
        return self.overall(flight)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the quantity that the fits show, given those of the flight so far."""
        raise NotImplementedError


@cache
def _discovered() -> tuple[type[Detector], ...]:
    from mavhums.health.detectors import actuator as detectors

    names = sorted(module.name for module in pkgutil.iter_modules(detectors.__path__))
    modules = (importlib.import_module(f"{detectors.__name__}.{name}") for name in names)
    return tuple(module.Detector for module in modules)


def to_inspect(fault: str) -> str | None:
    """Return what a maintainer should inspect for a fault; None if no detector looks for it.

    Examples
    --------
    >>> to_inspect("backlash")
    'gear and linkage for play'
    """
    own = inspected(fault)
    return own or next((detector.inspect for detector in _discovered() if detector.fault == fault), None)


def detectors_for(actuator: Actuator) -> list[Detector]:
    """Return a detector for every fault that can be looked for in this actuator.

    Examples
    --------
    >>> from mavhums.actuator import load_airframe
    >>> [detector.fault for detector in detectors_for(load_airframe("paper").actuators[0])][:3]
    ['backlash', 'friction', 'jam']
    """
    return [detector(actuator) for detector in _discovered() if detector.suits(actuator)]
