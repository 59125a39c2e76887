"""Lateness of samples, stream by stream, and the seconds that no stream can add to any more.

Messages of one type arrive in the order in which they were sent, but each type with a latency of its own. So
a sample is late only if it is not later than its stream's earlier ones, or if its second has been settled:
that needs every stream heard within :data:`HORIZON_S` to have passed the second. The stream that lags
most decides, but not by more than the horizon, which bounds what is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import kernel
from mavhums.vehicle.signals import CONTINUOUS, NAMES, Signal

__all__ = ["GAP_S", "HORIZON_S", "Order", "Received"]

HORIZON_S: Final = 30.0
"""Longest time for which a stream is waited for: above nearly all latencies of real links, and bounded."""

GAP_S: Final = 1.2
"""Longest distance of samples between which a signal is interpolated."""

_OPENING_S: Final = 10.0  # until every stream has been heard once, whatever its latency or the backlog
_LEAP_S: Final = 1.0  # a pause of the whole link ages no stream
_FINEST_S: Final = 1e-4  # closer samples are one: no sender can fill the memory of a horizon
_KEPT, _LATE, _REPEATED = range(3)
_CLOCK, _NEWEST_STAMPED, _NEWEST, _SETTLED = range(4)

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Received(NamedTuple):
    """Numbers of samples of a stream: kept, too late, and at the time of an earlier one."""

    kept: int
    late: int
    repeated: int


class Order:
    """Decides which samples of one vehicle's streams come in time, in the order of the log."""

    def __init__(self) -> None:
        count = len(NAMES)
        self._places = {name: k for k, name in enumerate(NAMES)}
        self._counts = np.zeros((count, len(Received._fields)), dtype=np.int64)
        self._newest, self._heard = np.full(count, -np.inf), np.full(count, -np.inf)
        self._kinds = np.array([[True, name in CONTINUOUS] for name in NAMES])
        self._state = np.array([0.0, -np.inf, -np.inf, -np.inf])

    @property
    def settled_s(self) -> float:
        """Flight time before which no sample is taken any more: a whole second, or minus infinity."""
        return float(self._state[_SETTLED])

    @property
    def newest_s(self) -> float:
        """Flight time of the newest sample of any stream; minus infinity before the first."""
        return float(self._state[_NEWEST])

    def received(self, name: str) -> Received:
        """Return the numbers of a signal's samples so far."""
        return Received(*self._counts[self._places[name]].tolist())

    def feed(self, signals: Sequence[Signal], times: Sequence[Array]) -> list[NDArray[np.bool_]]:
        """Return, of each signal, which samples come in time; ``times`` are flight times, s."""
        if not signals:
            return []
        edges = np.cumsum([0, *(time_s.size for time_s in times)])
        stream = np.concatenate(
            [np.full(signal.frame.size, self._places[signal.name], dtype=np.int64) for signal in signals]
        )
        for signal in signals:
            self._kinds[self._places[signal.name], 0] = signal.stamped
        order = np.argsort(np.concatenate([signal.frame for signal in signals]), kind="stable")
        kept = np.zeros(stream.size, dtype=np.bool_)
        kept[order] = _follow(
            stream[order], np.concatenate(times)[order],
            self._kinds, self._newest, self._heard, self._counts, self._state,
        )  # fmt: skip
        return [kept[a:b] for a, b in pairwise(edges)]


@kernel
def _follow(
    stream: Integers,
    time_s: Array,
    kinds: NDArray[np.bool_],
    newest: Array,
    heard: Array,
    counts: Integers,
    state: Array,
) -> NDArray[np.bool_]:
    kept = np.zeros(stream.size, dtype=np.bool_)
    for row in range(stream.size):
        k, time = stream[row], time_s[row]
        stamped = kinds[k, 0]
        # A message without a stamp has its sender's newest time or a later one: nothing waits for it.
        least = state[_SETTLED] if stamped else max(state[_SETTLED], state[_NEWEST_STAMPED])
        if abs(time - newest[k]) < _FINEST_S:
            counts[k, _REPEATED] += 1
        elif time < newest[k] or time < least:
            counts[k, _LATE] += 1
        else:
            counts[k, _KEPT] += 1
            kept[row] = True
        newest[k] = max(newest[k], time)
        if time > state[_NEWEST]:
            state[_CLOCK] += min(time - state[_NEWEST], _LEAP_S)
            state[_NEWEST] = time
        heard[k] = state[_CLOCK]
        if stamped:
            state[_NEWEST_STAMPED] = max(state[_NEWEST_STAMPED], time)
        reach = _reach(kinds, newest, heard, state)
        state[_SETTLED] = max(state[_SETTLED], np.floor(reach))
    return kept


@kernel
def _reach(kinds: NDArray[np.bool_], newest: Array, heard: Array, state: Array) -> float:
    """Return the time that every stream has passed."""
    reach, waiting = np.inf, False
    for k in range(newest.size):
        if state[_CLOCK] - heard[k] > HORIZON_S:
            continue
        if kinds[k, 0]:
            waiting = True
            reach = min(reach, newest[k])
        elif kinds[k, 1]:  # interpolated: its next sample may still answer for what lies within a gap
            reach = min(reach, max(newest[k], state[_NEWEST_STAMPED] - GAP_S))
    if not waiting:
        return float(state[_NEWEST] - HORIZON_S)
    if state[_CLOCK] < _OPENING_S:
        reach = -np.inf
    return float(max(reach, state[_NEWEST_STAMPED] - HORIZON_S))
