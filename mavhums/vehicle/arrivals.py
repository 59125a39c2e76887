"""Which samples of several streams come in time, in the order of the log.

Messages of one type arrive in the order in which they were sent, but each type with a latency of its own. So
a sample is late only if it is not later than its stream's earlier ones, or if its time has been settled:
that needs every stream heard within :data:`HORIZON_S` to have passed it. The stream that lags most decides,
but not by more than the horizon, which bounds what is kept. Samples that come later are counted and ignored,
so what is settled does not depend on how the log was cut into blocks.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Array1, Flags, Flags2, Integers, Integers1, Integers2
from mavhums.core.kernels import kernel, subroutine

_STREAMS: Final = 64  # more than a format has tables, or an actuator sources; none beyond is kept

HORIZON_S: Final = 30.0
"""Longest time for which a stream is waited for: above nearly all latencies of real links, and bounded."""

GAP_S: Final = 1.2
"""Longest distance of samples between which a signal is interpolated: streams of 1 Hz stay whole, with their
jitter; longer would invent motion between samples."""

_OPENING_S: Final = 10.0  # until every stream has been heard once, whatever its latency or the backlog
_LEAP_S: Final = 1.0  # a longer pause of the whole link does not age its streams
_FINEST_S: Final = 1e-4  # closer samples are one: no sender can fill the memory of a horizon
_KEPT, _LATE, _REPEATED = range(3)
_CLOCK, _NEWEST_STAMPED, _NEWEST, _SETTLED = range(4)


class Received(NamedTuple):
    """Numbers of samples of a stream: kept, too late, and at the time of an earlier one."""

    kept: int
    late: int
    repeated: int


class Arrivals(NamedTuple):
    """New samples of a stream: places in the log, (n,), increasing, and times, s, (n,).

    Attributes
    ----------
    stamped
        Whether the samples carry their own times; nothing waits for those without.
    interpolated
        Whether a sample also answers for the times before it.
    """

    stream: Hashable
    frame: Integers
    time_s: Array
    stamped: bool = True
    interpolated: bool = True


class Order:
    """Decides which samples of several streams come in time, in the order of the log.

    Parameters
    ----------
    steps_hz
        How often a second time is settled: a power of two, so that the times are exact.
    """

    def __init__(self, steps_hz: int = 1) -> None:
        self._steps_hz = steps_hz
        self._places: dict[Hashable, int] = {}
        self._counts = np.zeros((_STREAMS, len(Received._fields)), dtype=np.int64)
        self._newest, self._heard = np.full(_STREAMS, -np.inf), np.full(_STREAMS, -np.inf)
        self._kinds = np.ones((_STREAMS, 2), dtype=np.bool_)
        self._state = np.array([0.0, -np.inf, -np.inf, -np.inf])

    @property
    def complete_until_s(self) -> float:
        """Time before which no sample is taken any more: a whole number of steps, or minus infinity."""
        return float(self._state[_SETTLED])

    @property
    def newest_s(self) -> float:
        """Flight time of the newest sample of any stream; minus infinity before the first."""
        return float(self._state[_NEWEST])

    def received(self, stream: Hashable) -> Received:
        """Return the numbers of a stream's samples so far."""
        return Received(*self._counts[self._places[stream]].tolist())

    def feed(self, arrivals: Sequence[Arrivals]) -> list[Array]:
        """Return, for each sample, the time that was settled before it; NaN for one that does not count."""
        if not arrivals:
            return []
        edges = np.cumsum([0, *(new.frame.size for new in arrivals)])
        places = [self._places.setdefault(new.stream, len(self._places)) for new in arrivals]
        for new, place in zip(arrivals, places, strict=True):
            self._kinds[place] = new.stamped, new.interpolated
        stream = np.repeat(places, np.diff(edges))
        order = np.argsort(np.concatenate([new.frame for new in arrivals]), kind="stable")
        settled = np.empty(stream.size)
        settled[order] = _follow(
            stream[order], np.concatenate([new.time_s for new in arrivals])[order],
            self._kinds, self._newest, self._heard, self._counts, self._state, self._steps_hz,
        )  # fmt: skip
        return [settled[a:b] for a, b in pairwise(edges)]


@kernel
def _follow(
    stream: Integers1,
    time_s: Array1,
    kinds: Flags2,
    newest: Array1,
    heard: Array1,
    counts: Integers2,
    state: Array1,
    steps_hz: int,
) -> Array:
    settled = np.full(stream.size, np.nan)
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
            settled[row] = state[_SETTLED]
        newest[k] = max(newest[k], time)
        if time > state[_NEWEST]:
            state[_CLOCK] += min(time - state[_NEWEST], _LEAP_S)
            state[_NEWEST] = time
        heard[k] = state[_CLOCK]
        if stamped:
            state[_NEWEST_STAMPED] = max(state[_NEWEST_STAMPED], time)
        reach = _reach(kinds, newest, heard, state)
        state[_SETTLED] = max(state[_SETTLED], np.floor(reach * steps_hz) / steps_hz)
    return settled


@subroutine
def _reach(kinds: Flags, newest: Array, heard: Array, state: Array) -> float:
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
