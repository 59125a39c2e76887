"""The numbers of one flight by which an actuator is held against its earlier flights, without the log.

Neither windows nor what the limits decide depend on a baseline. So a flight is judged once, alone, and may
be held against any baseline later.
"""

from __future__ import annotations

from typing import NamedTuple

from mavhums.core.conditions import Condition
from mavhums.health.detector import Levels
from mavhums.report.assessment import Evidence

__all__ = ["ActuatorRecord", "Decided", "Estimate", "FaultRecord", "WindowRecord"]


class Estimate(NamedTuple):
    """A quantity, its standard error, and the degrees of freedom of that."""

    value: float
    error: float
    freedom: float


class WindowRecord(NamedTuple):
    """A window that does not overlap the one before; ``end_s`` is a flight time."""

    end_s: float
    value: float
    error: float
    freedom: float


class Decided(NamedTuple):
    """A change of what the limits decide, at the end of a window."""

    end_s: float
    condition: Condition
    since_s: float


class FaultRecord(NamedTuple):
    """What a flight leaves of one fault's indicator.

    Attributes
    ----------
    fault, quantity, unit, levels, two_sided
        As of its detector.
    windows, decided
        In the order of time.
    settled
        What the whole flight decided where no run of windows could; else None.
    whole
        The estimate of the whole flight; None if it has no meaning or does not show.
    latest
        The estimate that decided last; None if none did.
    evidence
        By the limits, as the verdict quotes it, unrounded.
    """

    fault: str
    quantity: str
    unit: str
    levels: Levels
    two_sided: bool
    windows: tuple[WindowRecord, ...]
    decided: tuple[Decided, ...]
    settled: Condition | None
    whole: Estimate | None
    latest: Estimate | None
    evidence: tuple[Evidence, ...]


class ActuatorRecord(NamedTuple):
    """What a flight leaves of one actuator.

    Attributes
    ----------
    window_s
        Length of a window.
    false_alarms
        Alarms per 100 hours, by which the limits decided.
    concluded_s
        Flight time from which the whole flight was judged; None if it was not, as of a jam.
    end_s
        Flight time of the last sample.
    vote
        End of the last window that a network voted on, and its probability of an emergency; None without.
    faults
        In the order of the detectors.
    """

    window_s: float
    false_alarms: float
    concluded_s: float | None
    end_s: float
    vote: tuple[float, float] | None
    faults: tuple[FaultRecord, ...]
