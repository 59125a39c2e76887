"""The sums of each slot from which a window's statistics follow (:mod:`mavhums.core.window_features`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.core.window_features import products
from mavhums.health.motion import Motion
from mavhums.health.slots import APART, Slots

__all__ = ["window_sums"]

_V1, _V2, _V3, _V4, _V5, _V7, _V11 = (column(f"V{k}") for k in (1, 2, 3, 4, 5, 7, 11))
_DEGREES_PER_REV_MIN_S = 6.0
_LONGEST_PERIODS = 2.5
"""A step in time of more periods of the lowest rate is a gap in the log, over which no path is known."""

Array = NDArray[np.float64]


def window_sums(actuator: Actuator, slots: Slots, moved: Motion) -> Array:
    """Return the sums of each slot, shape (k, ``SUMS``).

    A sample in motion counts where it has every quantity that at least half of the slot's samples in
    motion have; the sums of the other quantities are NaN in that slot.
    """
    return np.column_stack([_moving(actuator, slots, moved), _all(actuator, slots)])


def _moving(actuator: Actuator, slots: Slots, moved: Motion) -> Array:
    values, apart = moved.values, moved.apart
    ratio = actuator.known_ema().gear_ratio
    way = np.sign(values[:, _V7])
    turned = values[:, _V2] / ratio
    gap = np.where(apart & (values[:, _V3] != turned), values[:, _V3] - turned, np.nan)
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
    used = np.where(counts[:, None], np.where(finite & own, moments, 0.0), 0.0)
    sums = slots.sums(products(used))
    return np.where(products(np.where(carried, 1.0, np.nan)) == 1.0, sums, np.nan)


def _all(actuator: Actuator, slots: Slots) -> Array:
    """Return the sums over all samples: number, paths, what is missed, V4², what is carried, and the peak."""
    own, time_s, values = slots.judged, slots.time_s, slots.values
    ratio = actuator.known_ema().gear_ratio
    step_s = np.diff(time_s, prepend=time_s[0])
    whole = (step_s > 0) & (step_s < _LONGEST_PERIODS / actuator.min_rate_hz)
    commanded = np.abs(np.diff(values[:, _V1], prepend=values[0, _V1]))
    flown = np.abs(values[:, _V7]) * (_DEGREES_PER_REV_MIN_S / ratio) * step_s
    whole &= np.isfinite(commanded) & np.isfinite(flown)
    missed = values[:, _V1] - values[:, _V3]
    columns = np.column_stack(
        [
            np.ones(len(values)),
            np.where(whole, commanded, 0.0),
            np.where(whole, flown, 0.0),
            missed,
            missed**2,
            values[:, _V4] ** 2,
            np.isfinite(values[:, _V11]),
            (values[:, APART] > 0) & (values[:, _V3] != values[:, _V2] / ratio),
        ]
    )[own]
    peak = np.maximum.reduceat(np.nan_to_num(np.abs(values[own, _V4])), slots.start)
    return np.column_stack([slots.sums(np.nan_to_num(columns)), peak])
