"""Engine events about an actuator's health. Times are flight times, s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import Condition
from mavhums.health.decision.conditions import IndicatorChange
from mavhums.health.decision.records import Estimate, FaultRecord
from mavhums.results.standing import Interval


@dataclass(frozen=True, slots=True)
class Window:
    """Results of one ten-second window of one actuator.

    ``friction_nm`` and ``p_emergency`` are None if the window has no evidence for them;
    ``condition`` is the actuator's condition at the window's end.
    """

    vehicle: int
    actuator: str
    start_s: float
    end_s: float
    moving_fraction: float
    friction_nm: Interval | None
    p_emergency: float | None
    condition: Condition


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
