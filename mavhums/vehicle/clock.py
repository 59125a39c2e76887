"""Maps the sender's clock to the time of reception."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SenderClock"]

_JUMP_US = 2_000_000
_CONFIRM = 3


class SenderClock:
    """Maps a sender's microseconds since boot to UTC, causally.

    The first sample fixes the offset. If at least three consecutive samples differ from it by more than two
    seconds, the sender has rebooted or its clock was set, and a new segment starts. A shorter run is
    treated as damaged time stamps, and the offset stays. A sample whose mapped time lies more than two
    seconds after its reception gets the time of reception, so that later samples do not precede it.

    Parameters
    ----------
    wrap_us
        Period after which the sender's time restarts, as a 32-bit counter of microseconds does.

    Attributes
    ----------
    segments
        Number of segments so far.
    restarts
        Of the latest call: each row that starts a new segment after the first, and the segment's number.
    """

    def __init__(self, wrap_us: int | None = None) -> None:
        self.segments = 0
        self.restarts: list[tuple[int, int]] = []
        self._wrap_us = wrap_us
        self._offset_us = 0
        self._astray = 0

    def to_utc_us(self, sent_us: NDArray[np.int64], received_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return UTC in microseconds, shape (n,), from send times and reception times, shape (n,).

        Examples
        --------
        >>> clock = SenderClock()
        >>> clock.to_utc_us(np.array([5, 15, 25]), np.array([1000, 1011, 9_000_000])).tolist()
        [1000, 1010, 1020]
        """
        lag = received_us - sent_us
        if self._wrap_us and lag.size:
            reference = self._offset_us if self.segments else int(lag[0])
            laps = np.rint((lag - reference) / self._wrap_us).astype(np.int64)
            sent_us = sent_us + laps * self._wrap_us
            lag = received_us - sent_us
        utc = np.empty_like(lag)
        self.restarts = []
        start = 0
        while start < lag.size:
            if self.segments == 0:
                self._start_segment(int(lag[start]))
            end = self._end_of_segment(lag[start:]) + start
            ahead = lag[start:end] < self._offset_us - _JUMP_US
            utc[start:end] = np.where(ahead, received_us[start:end], sent_us[start:end] + self._offset_us)
            if end < lag.size:
                self._start_segment(int(lag[end]))
                self.restarts.append((end, self.segments))
            start = end
        return utc

    def _start_segment(self, offset_us: int) -> None:
        self._offset_us = offset_us
        self.segments += 1
        self._astray = 0

    def _end_of_segment(self, lag: NDArray[np.int64]) -> int:
        """Return the row at which the present offset ends, or the size; keep the run of outliers."""
        holds = np.abs(lag - self._offset_us) <= _JUMP_US
        if holds.all():
            self._astray = 0
            return lag.size
        good = np.flatnonzero(holds)
        edges = np.concatenate([[-1 - self._astray], good, [lag.size]])
        long = np.flatnonzero(np.diff(edges) > _CONFIRM)
        if long.size:
            return max(int(edges[long[0]]) + _CONFIRM, 0)
        self._astray = lag.size - 1 - int(edges[-2])
        return lag.size
