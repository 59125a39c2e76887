"""Plausibility of a record's TimeUS.

Across types times step back by less than a millisecond. A time more than a tenth of a second from the one
before counts as a step only if the next records continue from there; otherwise the stamp is damaged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import inlined, kernel
from mavhums.log.dataflash._layout import HEAD, WAIT, begins, time_at

__all__ = ["AHEAD", "BACK", "GAP_US", "IN_ORDER", "ODD", "is_near", "judge_time"]

IN_ORDER, AHEAD, BACK, ODD = 1, 2, 3, 4
"""A time near the one before, a step forward, a step back, and a damaged stamp."""

_TOLERANCE_US = 100_000
GAP_US = 60 * 1_000_000
_LATEST_US = 1 << 52
_CONFIRM = 2
_LOOKED_AT = 16


@kernel
def _confirm(
    data: NDArray[np.uint8], size: int, place: int, time_us: int, last: int, types: NDArray[np.void],
    final: bool,
) -> int:  # fmt: skip
    """Judge a time by the times of the records from ``place`` on."""
    before, agreed = time_us, 0
    for _ in range(_LOOKED_AT):
        if place + HEAD > size:
            if not final:
                return WAIT
            agreed += last < 0 or 0 < time_us - last <= GAP_US
            break
        length = int(types[data[place + 2]].length)
        if not begins(data, place) or length == 0:
            break
        if place + length > size:
            if not final:
                return WAIT
            break
        if types[data[place + 2]].timed:
            following = time_at(data, place)
            if following < before - _TOLERANCE_US:
                return ODD
            if agreed == 0 and time_us < last and -_TOLERANCE_US <= following - last <= GAP_US:
                return ODD
            before = following
            agreed += 1
            if agreed == _CONFIRM:
                break
        place += length
    if agreed == 0:
        return ODD
    return AHEAD if time_us > last else BACK


@inlined
def is_near(time_us: int, last: int) -> bool:
    """Return whether a time is in order after ``last``."""
    return bool(-_TOLERANCE_US <= time_us - last <= _TOLERANCE_US)


@inlined
def judge_time(
    data: NDArray[np.uint8], size: int, end: int, time_us: int, last: int, types: NDArray[np.void],
    final: bool,
) -> int:  # fmt: skip
    """Compare the time of a record that ends at ``end`` with ``last``, -1 if there is none."""
    if last >= 0 and is_near(time_us, last):
        return IN_ORDER
    if not 0 <= time_us < _LATEST_US:
        return ODD
    return _confirm(data, size, end, time_us, last, types, final)
