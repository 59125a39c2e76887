"""The interface between a log's format and the health of the aircraft: signals in SI units, by name.

A format adds one module in :mod:`mavhums.vehicle.signal_readers` that converts its tables to these signals;
the modules that use the signals do not depend on a message, a record or a topic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ALL_OUTPUTS", "CONTINUOUS", "NAMES", "OUTPUTS", "STEPPED", "Signal", "all_outputs", "placed"]

OUTPUTS: Final = 16
"""Servo outputs of the first message, whose use is followed."""

ALL_OUTPUTS: Final = 32
"""Servo outputs that can move a surface."""

CONTINUOUS: Final[Mapping[str, int]] = {
    "outputs": OUTPUTS,  # pulses, µs, NaN where an output is off
    "outputs_2": ALL_OUTPUTS,  # those that a second and a third message carry, NaN for the others
    "outputs_3": ALL_OUTPUTS,
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
    stamped
        Whether the samples carry their own times; those without are never earlier than their sender's others.
    """

    vehicle: int
    name: str
    source: str
    frame: NDArray[np.int64]
    time_us: NDArray[np.int64]
    values: NDArray[np.float64]
    stamped: bool = True


def all_outputs(signals: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the pulses of all outputs, (n, ALL_OUTPUTS), from the signals on a common grid."""
    first = signals["outputs"]
    pulses = placed(first, 0)
    for name in ("outputs_2", "outputs_3"):
        np.copyto(pulses, signals[name], where=np.isfinite(signals[name]))
    return pulses


def placed(pulses: NDArray[np.float64], first: int) -> NDArray[np.float64]:
    """Return pulses as columns from ``first`` of an array of all outputs, which is NaN elsewhere.

    Examples
    --------
    >>> placed(np.array([[1500.0]]), 16)[0, 15:18]
    array([  nan, 1500.,   nan])
    """
    wide = np.full((len(pulses), ALL_OUTPUTS), np.nan)
    wide[:, first : first + pulses.shape[1]] = pulses
    return wide
