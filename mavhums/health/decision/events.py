"""Engine events about an actuator's health. Times are flight times, s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import Condition
from mavhums.results.verdict import Interval


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
