"""The events that the engine reports while it reads; they are the same for a file and for a live link.

Times are flight times: seconds since the log's first frame.
"""

from __future__ import annotations

from dataclasses import dataclass

from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.health.decision.events import (
    Classified,
    ComparisonInput,
    ConditionChanged,
    Forgotten,
    Indication,
    Window,
)
from mavhums.vehicle.states import Attitude, FlightMode, Followed, Position

__all__ = [
    "AirframeNamed",
    "Attitude",
    "Classified",
    "ComparisonInput",
    "ConditionChanged",
    "Event",
    "FlightMode",
    "Followed",
    "Forgotten",
    "Indication",
    "Notice",
    "Position",
    "Samples",
    "Window",
]


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
    | Followed
    | Position
    | FlightMode
    | ComparisonInput
    | Forgotten
)
