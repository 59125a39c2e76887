"""Detection of motion: only samples in motion are evidence of friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import KEYS, column
from mavhums.health.slots import APART, BUS, GUARD_S, MAGNITUDES, TURNED, Slots

__all__ = ["Motion", "lasting", "motion"]

_PERIODS = 2.5
_LASTING_S = GUARD_S - 5e-7  # times are whole microseconds; rounding must not affect the comparison
_V7 = column("V7")

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """Motion of the output shaft at each judged sample of the slots; arrays of shape (n,).

    Attributes
    ----------
    moving
        Whether the rotor turns in one direction and fast enough from :data:`~mavhums.health.slots.GUARD_S`
        before the sample until as long after it, and the sample rate is high enough for evidence. (At a
        reversal the shaft first moves through the gear's play, and sticks.)
    speed, acceleration
        Speed of the output shaft, rad/s, and acceleration, rad/s², from central differences; NaN without
        neighbours.
    speed_around
        Mean of the speeds before and after, rad/s. With a stepwise command, a sample's own speed and
        current depend on the phase of the step.
    values
        V1…V12, shape (n, 12).
    bus_v
        Voltage of the supply bus, V; NaN if the log does not carry it.
    apart
        Whether separate sensors measured V2 and V3.
    turned
        Whether the rotor's speed follows from the output shaft's.
    magnitudes
        Of V4, V5 and V7 from a source that does not measure their signs, else NaN; shape (n, 3).
    """

    moving: NDArray[np.bool_]
    speed: Array
    acceleration: Array
    speed_around: Array
    values: Array
    bus_v: Array
    apart: NDArray[np.bool_]
    turned: NDArray[np.bool_]
    magnitudes: Array


def motion(actuator: Actuator, slots: Slots) -> Motion:
    """Return the motion at the samples that the slots judge."""
    time_s, rev_min = slots.time_s, slots.values[:, _V7]
    speed = rev_min * actuator.rad_s(1.0)
    span = np.full(time_s.size, np.nan)
    acceleration, around = span.copy(), span.copy()
    span[1:-1] = time_s[2:] - time_s[:-2]
    acceleration[1:-1] = (speed[2:] - speed[:-2]) / span[1:-1]
    around[1:-1] = (speed[2:] + speed[:-2]) / 2
    longest_s = _PERIODS / actuator.min_rate_hz
    moving = lasting(time_s, rev_min, actuator.moving_speed_rev_min, longest_s) & (span < longest_s)
    own = slots.judged
    values = slots.values[own]
    return Motion(
        moving[own],
        speed[own],
        acceleration[own],
        around[own],
        values[:, : len(KEYS)],
        values[:, BUS],
        values[:, APART] > 0,
        values[:, TURNED] > 0,
        values[:, MAGNITUDES],
    )


def lasting(time_s: Array, speed: Array, moving_speed: float, longest_gap_s: float) -> NDArray[np.bool_]:
    """Return which samples move one way, fast enough, from ``GUARD_S`` before until as long after.

    Parameters
    ----------
    time_s, speed
        Increasing times and the speeds then, shape (n,).
    moving_speed
        From which on a sample moves, in the speed's unit.
    longest_gap_s
        A longer gap between samples ends a motion.
    """
    way = np.sign(speed)
    fast: NDArray[np.bool_] = np.abs(speed) > moving_speed
    gap = np.diff(time_s) > longest_gap_s
    turns = np.flatnonzero((way[1:] != way[:-1]) | gap)
    run = np.searchsorted(turns, np.arange(time_s.size))
    begin = time_s[np.concatenate([[0], turns + 1])[run]]
    end = time_s[np.concatenate([turns, [time_s.size - 1]])[run]]
    fast[1:-1] &= fast[2:] & fast[:-2]
    lasts: NDArray[np.bool_] = (time_s - begin >= _LASTING_S) & (end - time_s >= _LASTING_S)
    return fast & lasts
