"""Detection of motion: only samples in motion are evidence of friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Array1, Flags
from mavhums.core.kernels import kernel
from mavhums.core.quantities import KEYS, column, products
from mavhums.core.statistics import DEGREES_S_PER_REV_MIN, RAD_S_PER_REV_MIN
from mavhums.health.estimation.slots import BUS, MAGNITUDES, ROTOR_SENSED, SENSED, TURNED, Slots
from mavhums.health.estimation.thresholds import GUARD_S, LONGEST_GAP_PERIODS

_LASTING_S = GUARD_S - 5e-7  # times are whole microseconds; rounding must not affect the comparison
_V1, _V2, _V3, _V4, _V5, _V7, _V10, _V11 = (column(f"V{k}") for k in (1, 2, 3, 4, 5, 7, 10, 11))


class Motion(NamedTuple):
    """Motion of the output shaft at each judged sample of the slots; arrays of shape (n,).

    Attributes
    ----------
    moving
        Whether the rotor turns in one direction and fast enough from ``GUARD_S``
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
    behind
        Command minus the output shaft's angle, °; NaN where no sensor measured the angle.
    bus_v
        Voltage of the supply bus, V; NaN if the log does not carry it.
    angles
        Whether a sensor measured V2, and V3, shape (n, 2).
    turned
        Whether the rotor's speed follows from the output shaft's.
    magnitudes
        Of V4, V5 and V7 from a source that does not measure their signs, else NaN; shape (n, 3).
    load
        Torque that the gear transmits, N·m; zero where the friction does not depend on it.
    """

    moving: Flags
    speed: Array
    acceleration: Array
    speed_around: Array
    values: Array
    behind: Array
    bus_v: Array
    angles: Flags
    turned: Flags
    magnitudes: Array
    load: Array

    @property
    def apart(self) -> Flags:
        """Whether separate sensors measured V2 and V3."""
        return np.asarray(self.angles.all(axis=1))


def longest_gap_s(actuator: Actuator) -> float:
    """Return the time between samples beyond which nobody knows how the shaft moved."""
    return LONGEST_GAP_PERIODS / actuator.min_rate_hz


def motion(actuator: Actuator, slots: Slots) -> Motion:
    """Return the motion at the samples that the slots judge."""
    # Without constants the gear ratio is unknown, and the output shaft's own speed shows the motion.
    ratio, of = (actuator.ema.gear_ratio, _V7) if actuator.ema else (1.0, _V10)
    time_s, rev_min = slots.time_s, slots.values[:, of]
    speed = rev_min * (RAD_S_PER_REV_MIN / ratio)
    acceleration, span = central_slope(time_s, speed)
    around = np.full(time_s.size, np.nan)
    around[1:-1] = (speed[2:] + speed[:-2]) / 2
    longest_s = longest_gap_s(actuator)
    # At a low rate differences over a gap are no acceleration.
    moving = lasting(time_s, rev_min, actuator.moving_speed_deg_s * ratio / 6.0, longest_s) & (
        span < longest_s
    )
    own = slots.judged
    values = slots.values[own]
    return Motion(
        moving[own],
        speed[own],
        acceleration[own],
        around[own],
        values[:, : len(KEYS)],
        np.where(values[:, SENSED] > 0, values[:, _V1] - values[:, _V3], np.nan),
        values[:, BUS],
        values[:, [ROTOR_SENSED, SENSED]] > 0,
        values[:, TURNED] > 0,
        values[:, MAGNITUDES],
        np.zeros(len(values)),
    )


def central_slope(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Return the slope between each sample's neighbours, and their distance in time; NaN at the ends.

    Examples
    --------
    >>> central_slope(np.array([0.0, 1.0, 4.0]), np.array([0.0, 9.0, 8.0]))
    (array([nan,  2., nan]), array([nan,  4., nan]))
    """
    slope, span = np.full((2, time_s.size), np.nan)
    span[1:-1] = time_s[2:] - time_s[:-2]
    slope[1:-1] = (values[2:] - values[:-2]) / span[1:-1]
    return slope, span


def lasting(time_s: Array, speed: Array, moving_speed: float, longest_gap_s: float) -> Flags:
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
    fast: Flags = np.abs(speed) > moving_speed
    gap = np.diff(time_s) > longest_gap_s
    turns = np.flatnonzero((way[1:] != way[:-1]) | gap)
    run = np.searchsorted(turns, np.arange(time_s.size))
    begin = time_s[np.concatenate([[0], turns + 1])[run]]
    end = time_s[np.concatenate([turns, [time_s.size - 1]])[run]]
    # A single fast sample between slow ones is noise of the sensor.
    fast[1:-1] &= fast[2:] & fast[:-2]
    lasts: Flags = (time_s - begin >= _LASTING_S) & (end - time_s >= _LASTING_S)
    return fast & lasts


@kernel
def angle_speed(time_s: Array1, angle: Array1, half_s: float) -> Array:
    """Return the speed from an angle: the slope of a line over ``half_s`` either way, shape (n,).

    At least the neighbours are taken; NaN without them. A line and a parabola have the same slope there.
    """
    speed = np.full(time_s.size, np.nan)
    for i in range(1, time_s.size - 1):
        first, last = i - 1, i + 1
        while first > 0 and time_s[first - 1] >= time_s[i] - half_s:
            first -= 1
        while last < time_s.size - 1 and time_s[last + 1] <= time_s[i] + half_s:
            last += 1
        time_mean = angle_mean = 0.0
        for k in range(first, last + 1):
            time_mean += (time_s[k] - time_s[i]) / (last - first + 1)
            angle_mean += (angle[k] - angle[i]) / (last - first + 1)
        across = along = 0.0
        for k in range(first, last + 1):
            step = time_s[k] - time_s[i] - time_mean
            along += step * (angle[k] - angle[i] - angle_mean)
            across += step * step
        speed[i] = along / across
    return speed


def window_sums(actuator: Actuator, slots: Slots, moved: Motion) -> Array:
    """Return the sums of each slot, shape (k, ``SUMS``).

    A sample in motion counts where it has every quantity that at least half of the slot's samples in
    motion have; the sums of the other quantities are NaN in that slot.
    """
    return np.column_stack([_moving(actuator, slots, moved), _all(actuator, slots)])


def _moving(actuator: Actuator, slots: Slots, moved: Motion) -> Array:
    values = moved.values
    way = np.sign(values[:, _V7])
    gap = np.where(moved.apart, values[:, _V3] - values[:, _V2] / actuator.known_ema().gear_ratio, np.nan)
    slope = moved.acceleration / actuator.rad_s(1.0) * 1e-3
    moments = np.column_stack(
        [
            np.ones(len(values)),
            way,
            values[:, [_V3, _V4, _V5]],
            values[:, _V7] * 1e-3,
            slope,
            values[:, _V11],
            gap,
            np.sign(values[:, _V5]),
        ]
    )
    finite = np.isfinite(moments)
    seen = moved.moving
    has = slots.sums((finite & seen[:, None]).astype(np.float64))
    carried = 2 * has >= slots.sums(seen[:, None].astype(np.float64))
    own = np.repeat(carried, slots.count(), axis=0)
    counts = seen & (finite | ~own).all(axis=1)
    # Products of a quantity that the slot lacks are NaN below, whatever is here.
    used = np.where(counts[:, None] & finite, moments, 0.0)
    sums = slots.sums(products(used))
    return np.where(products(np.where(carried, 1.0, np.nan)) == 1.0, sums, np.nan)


def _all(actuator: Actuator, slots: Slots) -> Array:
    """Return the sums over all samples: number, paths, what is missed, V4², what is carried, and the peak."""
    own, time_s, values = slots.judged, slots.time_s, slots.values
    ratio = actuator.known_ema().gear_ratio
    step_s = np.diff(time_s, prepend=time_s[0])
    # Over a gap in the log no path is known.
    whole = (step_s > 0) & (step_s < longest_gap_s(actuator))
    commanded = np.abs(np.diff(values[:, _V1], prepend=values[0, _V1]))
    flown = np.abs(values[:, _V7]) * (DEGREES_S_PER_REV_MIN / ratio) * step_s
    whole &= np.isfinite(commanded) & np.isfinite(flown)
    missed = values[:, _V1] - values[:, _V3]
    # Its sign is often unknown while nothing moves, its square is not.
    volts = np.fmax(np.abs(values[:, _V4]), values[:, MAGNITUDES.start])
    columns = np.column_stack(
        [
            np.ones(len(values)),
            np.where(whole, commanded, 0.0),
            np.where(whole, flown, 0.0),
            missed,
            missed**2,
            volts**2,
            np.isfinite(missed),
            (values[:, [ROTOR_SENSED, SENSED]] > 0).all(axis=1)
            & np.isfinite(values[:, [_V2, _V3]]).all(axis=1),
            np.isfinite(volts),
            np.isfinite(values[:, _V11]),
        ]
    )[own]
    peak = np.maximum.reduceat(np.nan_to_num(volts[own]), slots.start)
    return np.column_stack([slots.sums(np.nan_to_num(columns)), peak])
