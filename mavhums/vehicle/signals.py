"""The interface between a log's format and the health of the aircraft: signals in SI units, by name.

A format adds one module in :mod:`mavhums.vehicle.signal_readers` that converts its tables to these signals;
the modules that use the signals do not depend on a message, a record or a topic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CONTINUOUS", "NAMES", "OUTPUTS", "STEPPED", "Signal"]

OUTPUTS: Final = 16
"""Servo outputs that are followed."""

CONTINUOUS: Final[Mapping[str, int]] = {
    "outputs": OUTPUTS,  # pulses, µs, NaN where an output is off
    "rates": 3,  # roll, pitch, yaw rate of the fastest gyro, rad/s
    "slow_rates": 3,  # the same from the attitude estimate
    "force": 3,  # specific force, forward, right, down, m/s²
    "attitude": 3,  # roll, pitch, yaw, rad
    "demand": 2,  # demanded roll and pitch, rad
    "airspeed": 1,  # m/s
    "velocity": 2,  # over ground, north and east, m/s
    "groundspeed": 1,  # m/s
    "altitude": 1,  # above where it started or above sea level, m
}
"""Signals that change steadily, and their number of columns."""

STEPPED: Final[Mapping[str, int]] = {
    "state": 4,  # MAV_TYPE, MAV_AUTOPILOT, armed, custom mode
    "vtol": 1,  # MAV_VTOL_STATE
    "landed": 1,  # MAV_LANDED_STATE
}
"""Signals that hold until they are told anew."""

NAMES: Final = (*CONTINUOUS, *STEPPED)


class Signal(NamedTuple):
    """New values of one signal of one vehicle.

    Attributes
    ----------
    source
        Message or record, as a verdict names it.
    frame
        Positions in the log, shape (n,), increasing.
    time_us
        Microseconds of UTC, shape (n,).
    values
        Shape (n, columns of the signal), NaN where unknown.
    """

    vehicle: int
    name: str
    source: str
    frame: NDArray[np.int64]
    time_us: NDArray[np.int64]
    values: NDArray[np.float64]
