"""What the engine reports while it reads; the same for a file and for a live link.

Times are flight times: seconds since the log's first frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Airframe
from mavhums.report.assessment import Condition, Interval

__all__ = [
    "AirframeNamed",
    "Attitude",
    "ConditionChanged",
    "Event",
    "FlightMode",
    "Indication",
    "Notice",
    "Position",
    "Samples",
    "Window",
]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Quantities V1…V12 of one actuator: ``time_s`` of shape (n,), ``values`` of shape (n, 12).

    A quantity that the log does not carry is NaN.
    """

    vehicle: int
    actuator: str
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Window:
    """What ten seconds of one actuator show.

    ``friction_nm`` and ``p_emergency`` are None where the window does not carry the evidence,
    and ``condition`` is what the actuator is held to be at the window's end.
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
    """An actuator's condition changed; ``since_s`` is where it did, ``time_s`` when it was certain.

    ``fault`` is what changed it.
    """

    vehicle: int
    actuator: str
    time_s: float
    since_s: float
    before: Condition
    after: Condition
    rule: str
    fault: str = "friction"


@dataclass(frozen=True, slots=True, eq=False)
class Indication:
    """The quantity that shows a fault, in the windows that end at ``end_s``; arrays of shape (n,).

    ``low`` and ``high`` bound the 95 % interval. Windows that cannot show it are left out.
    """

    vehicle: int
    actuator: str
    fault: str
    end_s: NDArray[np.float64]
    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AirframeNamed:
    """The profile by which a vehicle, every one if None, is judged from here on."""

    time_s: float
    vehicle: int | None
    airframe: Airframe


@dataclass(frozen=True, slots=True)
class Notice:
    """A text from the vehicle, or about the log itself."""

    time_s: float
    vehicle: int | None
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """How a vehicle lies in the air: ``time_s`` of shape (n,), increasing; angles of shape (n, 3).

    Roll (right wing down), pitch (nose up) and yaw (clockwise from north), as ATTITUDE has them.
    """

    vehicle: int
    time_s: NDArray[np.float64]
    roll_pitch_yaw_rad: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Position:
    """Where a vehicle is: ``time_s`` of shape (n,), increasing, and with it a position and an altitude.

    ``latitude_longitude_deg`` has shape (n, 2), ``altitude_m``, above mean sea level, (n,).
    """

    vehicle: int
    time_s: NDArray[np.float64]
    latitude_longitude_deg: NDArray[np.float64]
    altitude_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FlightMode:
    """A vehicle entered a flight mode, by the name that its autopilot's ground station gives it."""

    vehicle: int
    time_s: float
    mode: str


Event = (
    Samples
    | Window
    | ConditionChanged
    | Indication
    | AirframeNamed
    | Notice
    | Attitude
    | Position
    | FlightMode
)
