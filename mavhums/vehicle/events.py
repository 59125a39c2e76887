"""The events of a vehicle's state. Times are flight times: seconds since the log's start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Attitude", "FlightMode", "Followed", "Position"]


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """The attitude of a vehicle: ``time_s`` of shape (n,), increasing; angles of shape (n, 3).

    The angles are roll (right wing down), pitch (nose up) and yaw (clockwise from north), as in ATTITUDE.
    """

    vehicle: int
    time_s: NDArray[np.float64]
    roll_pitch_yaw_rad: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """The demanded and the flown angle about an axis: ``time_s`` of shape (n,), increasing.

    ``actuator`` is the axis, ``roll`` or ``pitch``; ``angles_rad`` has shape (n, 2), the demand first, NaN
    where it is not known.
    """

    vehicle: int
    actuator: str
    time_s: NDArray[np.float64]
    angles_rad: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Position:
    """The position of a vehicle: ``time_s`` of shape (n,), increasing, with coordinates and altitude.

    ``latitude_longitude_deg`` has shape (n, 2); ``altitude_m``, above mean sea level, has shape (n,).
    """

    vehicle: int
    time_s: NDArray[np.float64]
    latitude_longitude_deg: NDArray[np.float64]
    altitude_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FlightMode:
    """A vehicle entered a flight mode, named as its autopilot's ground station names it."""

    vehicle: int
    time_s: float
    mode: str
