"""The record of one flight, from which an actuator is compared with its earlier flights, without the log.

Windows and the decisions by limits do not depend on a baseline. A flight is therefore judged once, alone,
and can be compared with any baseline later.
"""

from __future__ import annotations

from typing import NamedTuple

from mavhums.core.conditions import Condition
from mavhums.health.decision.limits import Levels
from mavhums.results.verdict import Evidence


class Estimate(NamedTuple):
    """A quantity, its standard error, and the degrees of freedom of the error."""

    value: float
    error: float
    freedom: float


class WindowRecord(NamedTuple):
    """A window that does not overlap the previous one; ``end_s`` is a flight time."""

    end_s: float
    value: float
    error: float
    freedom: float


class Decided(NamedTuple):
    """A change of the decision by limits, at the end of a window."""

    end_s: float
    condition: Condition
    since_s: float


class FaultRecord(NamedTuple):
    """The record of one fault's indicator in a flight.

    Attributes
    ----------
    fault, quantity, unit, levels, two_sided
        As in its detector.
    windows, decided
        In the order of time.
    settled
        Decision by the whole flight if no run of windows decided; else None.
    whole
        The estimate of the whole flight; None if it is not defined or has no evidence.
    latest
        The estimate of the last decision; None if there is none.
    evidence
        Evidence according to the limits, as in the verdict, unrounded.
    """

    fault: str
    quantity: str
    unit: str
    levels: Levels
    two_sided: bool
    windows: tuple[WindowRecord, ...] = ()
    decided: tuple[Decided, ...] = ()
    settled: Condition | None = None
    whole: Estimate | None = None
    latest: Estimate | None = None
    evidence: tuple[Evidence, ...] = ()


class ActuatorRecord(NamedTuple):
    """The record of one actuator in a flight.

    Attributes
    ----------
    window_s
        Length of a window.
    false_alarms
        Allowed alarms per 100 hours in the decision by limits.
    concluded_s
        Flight time from which the whole flight was judged; None if it was not, for example after a jam.
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
