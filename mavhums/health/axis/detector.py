"""The interface of axis detectors: modules in :mod:`mavhums.health.detectors.axis` with a class ``Detector``.

They are discovered automatically; all pass the same checks, ``tests/health/axis/test_detectors.py``.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, NamedTuple, Protocol

from mavhums.core.conditions import Condition
from mavhums.health.axis.gain import Gain
from mavhums.health.axis.reference import Second
from mavhums.report.axis_limits import AxisLimits
from mavhums.vehicle.flight import Rows

__all__ = ["Detector", "Seen", "Shown", "detectors", "to_inspect"]


class Shown(NamedTuple):
    """A fault that is certain according to a detector, in the second that ends at ``end_s``."""

    axis: str
    end_s: int
    fault: str
    condition: Condition
    since_s: int
    value: float
    limit: float
    rule: str
    confidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Input of the detectors: new rows, and the gain of each axis in each second."""

    rows: Rows
    seconds: Mapping[str, Sequence[Second]]
    gains: Mapping[str, Gain]


class Detector(Protocol):
    """Detects one kind of fault.

    Attributes
    ----------
    axes, faults
        Axes that it judges, and faults that it can report.
    inspect
        The parts that the maintainer should inspect, by fault.
    """

    axes: ClassVar[tuple[str, ...]]
    inspect: ClassVar[Mapping[str, str]]

    def __init__(self, limits: AxisLimits) -> None:
        """Create the detector with these limits."""
        ...

    def feed(self, seen: Seen) -> list[Shown]:
        """Return the certain faults in each new second."""
        ...


@cache
def _discovered() -> tuple[type[Detector], ...]:
    from mavhums.health.detectors import axis

    names = sorted(module.name for module in pkgutil.iter_modules(axis.__path__))
    modules = (importlib.import_module(f"{axis.__name__}.{name}") for name in names)
    return tuple(module.Detector for module in modules)


def detectors(limits: AxisLimits) -> list[Detector]:
    """Return all detectors of axes."""
    return [detector(limits) for detector in _discovered()]


def to_inspect(fault: str) -> str | None:
    """Return the parts to inspect for a fault of an axis; None if no detector covers it.

    Examples
    --------
    >>> to_inspect("hard_over")
    'for a surface that stands deflected: its servo, its linkage, its trim'
    """
    return next((d.inspect[fault] for d in _discovered() if fault in d.inspect), None)
