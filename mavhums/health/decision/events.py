"""Engine events about an actuator's health, and the records kept of them. Times are flight times, s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import Condition
from mavhums.health.decision.conditions import IndicatorChange
from mavhums.health.decision.limits import Levels
from mavhums.results.verdict import Evidence, Interval


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


class DecisionChange(NamedTuple):
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
    decided: tuple[DecisionChange, ...] = ()
    settled: Condition | None = None
    whole: Estimate | None = None
    latest: Estimate | None = None
    evidence: tuple[Evidence, ...] = ()


class ActuatorRecord(NamedTuple):
    """The record of one actuator in a flight.

    Attributes
    ----------
    false_alarms
        Allowed alarms per 100 hours in the decision by limits.
    concluded_s
        Flight time from which the whole flight was judged; None if it was not, for example after a jam.
    end_s
        Flight time of the last sample.
    faults
        In the order of the detectors.
    """

    false_alarms: float
    concluded_s: float | None
    end_s: float
    faults: tuple[FaultRecord, ...]


@dataclass(frozen=True, slots=True)
class Window:
    """Results of one ten-second window of one actuator.

    ``friction_nm`` is None if the window has no evidence for it. ``network`` is the class that a network
    gives the window, ``abstained`` or ``outside`` its training range, and None if none was asked;
    ``probability`` that of the class, or of the likeliest, and ``p_fault`` of all faults together.
    ``condition`` is the actuator's condition at the window's end.
    """

    vehicle: int
    actuator: str
    start_s: float
    end_s: float
    moving_fraction: float
    friction_nm: Interval | None
    condition: Condition
    network: str | None = None
    probability: float | None = None
    p_fault: float | None = None


@dataclass(frozen=True, slots=True)
class ConditionChanged:
    """An actuator's condition changed at ``since_s``; it was decided at ``time_s``.

    ``fault`` is the cause; ``finding`` describes it briefly for an alert if the fault's name does not
    suffice.
    """

    vehicle: int
    actuator: str
    time_s: float
    since_s: float
    before: Condition
    after: Condition
    rule: str
    fault: str = "friction"
    finding: str = ""


class IndicatorStep(NamedTuple):
    """What a window says of one indicator, of which ``indicator`` is the description, without a flight.

    ``estimate`` is None if the window overlaps the previous one that has one, or shows nothing; ``change`` is
    the change of the decision by limits, if there is one.
    """

    indicator: FaultRecord
    estimate: Estimate | None
    change: IndicatorChange | None


@dataclass(frozen=True, slots=True)
class ComparisonInput:
    """What an actuator's window adds to the comparison with its earlier flights; it precedes the window.

    With ``whole``, it is the flight as a whole, which may decide at its end.
    """

    vehicle: int
    actuator: str
    start_s: float
    end_s: float
    steps: tuple[IndicatorStep, ...]
    whole: bool = False


@dataclass(frozen=True, slots=True)
class Forgotten:
    """What was judged of an actuator no longer counts, for the reason in ``rule``."""

    vehicle: int
    actuator: str
    time_s: float
    rule: str


@dataclass(frozen=True, slots=True, eq=False)
class Indication:
    """A fault indicator in the windows that end at ``end_s``; arrays of shape (n,).

    ``low`` and ``high`` bound the 95 % interval. Windows without evidence are omitted.
    """

    vehicle: int
    actuator: str
    fault: str
    end_s: Array
    value: Array
    low: Array
    high: Array


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What lies behind the judgement of a subject, for a recording or a report: it decides nothing.

    Attributes
    ----------
    kind
        ``evidence`` for a fault, beside that of an alarm; ``response`` of an axis, beside what its outputs
        make of it in the reference, rad/s, rad/s² or m/s²; ``thrust`` asked of a motor, a share of its full
        one, beside the mean of all motors; ``roll_angle`` and ``pitch_angle``, rad, beside those demanded.
    time_s
        Increasing, shape (n,).
    values
        What it is compared with, NaN where that is not known, and the value; shape (n, 2).
    reference_s
        Flight seconds from and to which the reference was learned; None without one.
    """

    vehicle: int
    actuator: str
    kind: str
    time_s: Array
    values: Array
    reference_s: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Classified:
    """What a network says of single samples, for a recording or a report; arrays of shape (n,).

    ``p_emergency`` is NaN and ``said``, the index into ``classes``, is -1 where a sample lacks an input of
    every network; where it is not ``inside`` the training range, the network abstains.
    """

    vehicle: int
    actuator: str
    time_s: Array
    p_emergency: Array
    said: NDArray[np.int8]
    inside: Flags
    classes: tuple[str, ...]
