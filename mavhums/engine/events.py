"""The events that the engine reports while it reads; they are the same for a file and for a live link.

Times are flight times: seconds since the log's first frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.health.decision.events import (
    Classified,
    ConditionChanged,
    Indication,
    Trace,
    Window,
)
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.results.assessment import Assessment
from mavhums.vehicle.states import Attitude, FlightMode, Position


@dataclass(frozen=True, slots=True)
class Notice:
    """A text from the vehicle, or about the log itself."""

    time_s: float
    vehicle: int | None
    text: str


Event = (
    Samples
    | Window
    | ConditionChanged
    | Indication
    | Classified
    | AirframeNamed
    | Notice
    | Attitude
    | Trace
    | Position
    | FlightMode
)


class StandaloneAssessment(NamedTuple):
    """A flight judged by itself.

    Attributes
    ----------
    assessment
        The assessment without any baseline.
    profiles
        Name of the profile by which each actuator was judged, by vehicle and actuator.
    false_alarms
        Accepted number of false alarms in 100 hours of an actuator or an axis.
    """

    assessment: Assessment
    profiles: Mapping[tuple[int, str], str]
    false_alarms: float = FALSE_ALARMS
