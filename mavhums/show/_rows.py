"""Rows over flight time: thinned for display in bounded memory, and written to a Rerun stream."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array

if TYPE_CHECKING:
    import rerun as rr

_BATCH = 4096


class Thinner:
    """Keeps at most ``capacity`` rows; all rows, unchanged, while they fit.

    When the capacity is exceeded, each group of neighbouring rows is replaced by two, and the group size
    doubles. The number of rows of a long flight therefore stays between half the capacity and the capacity.

    Parameters
    ----------
    columns
        Number of columns of each row, without its time.
    capacity
        Number of rows; a multiple of four.
    keep
        ``"extremes"``: the smallest and the largest value of each column in each group, in their original
        order, at the times of the group's first and last row; this preserves peaks. ``"first"``: whole
        rows, for columns that belong together.

    Examples
    --------
    >>> thinner = Thinner(1, 4)
    >>> thinner.add(np.arange(8.0), np.array([[0], [9], [1], [2], [3], [-5], [4], [5.0]]))
    >>> time, values = thinner.rows()
    >>> time.tolist(), values[:, 0].tolist()
    ([0.0, 3.0, 4.0, 7.0], [0.0, 9.0, -5.0, 5.0])
    """

    def __init__(self, columns: int, capacity: int, keep: Literal["extremes", "first"] = "extremes") -> None:
        self.group = 1
        self._capacity = capacity
        self._merge = _extremes if keep == "extremes" else _first
        self._time = np.empty(capacity)
        self._values = np.empty((capacity, columns))
        self._size = 0
        self._waiting: list[tuple[Array, Array]] = []
        self._waiting_rows = 0

    def add(self, time_s: Array, values: Array) -> None:
        """Add rows: times of shape (n,), increasing, and values of shape (n, columns)."""
        self._waiting.append((time_s, values))
        self._waiting_rows += time_s.size
        if self._waiting_rows >= max(_BATCH, 2 * self.group):
            self._take(final=False)

    def rows(self) -> tuple[Array, Array]:
        """Return the kept rows: times of shape (m,) and values of shape (m, columns)."""
        self._take(final=True)
        return self._time[: self._size], self._values[: self._size]

    def _take(self, *, final: bool) -> None:
        if not self._waiting:
            return
        time = np.concatenate([part for part, _ in self._waiting])
        values = np.concatenate([part for _, part in self._waiting])
        start = 0
        while start < time.size:
            rows = min(time.size - start, self._room())
            size = rows - rows % self.group
            if size == 0:
                if not final:
                    break
                size = min(time.size - start, self.group)
            self._append(*self._thinned(time[start : start + size], values[start : start + size]))
            start += size
        self._waiting = [(time[start:], values[start:])] if start < time.size else []
        self._waiting_rows = time.size - start

    def _room(self) -> int:
        """Return the number of rows that fit, after thinning if there is no space."""
        if self._size + 2 > self._capacity:
            whole = self._size - self._size % 4
            kept = self._merge(self._time[:whole], self._values[:whole], 4)
            rest = self._time[whole : self._size].copy(), self._values[whole : self._size].copy()
            self._size = 0
            self._append(*kept)
            self._append(*rest)
            self.group = max(2 * self.group, 4)
        rows = self._capacity - self._size
        return rows if self.group == 1 else rows // 2 * self.group

    def _thinned(self, time: Array, values: Array) -> tuple[Array, Array]:
        if self.group == 1 or time.size < 2:
            return time, values
        return self._merge(time, values, min(self.group, time.size))

    def _append(self, time: Array, values: Array) -> None:
        end = self._size + time.size
        self._time[self._size : end], self._values[self._size : end] = time, values
        self._size = end


def _extremes(time: Array, values: Array, group: int) -> tuple[Array, Array]:
    """Return two rows for each ``group`` of rows; NaN is kept only if all values are NaN."""
    groups = values.reshape(-1, group, values.shape[1])
    lowest, highest = np.fmin.reduce(groups, axis=1), np.fmax.reduce(groups, axis=1)
    rising = _place(groups, lowest) <= _place(groups, highest)
    two = np.stack([np.where(rising, lowest, highest), np.where(rising, highest, lowest)], axis=1)
    thinned = np.asarray(two, dtype=np.float64).reshape(-1, values.shape[1])
    return _ends(time, group), thinned


def _place(groups: Array, wanted: Array) -> NDArray[np.int64]:
    return np.asarray(np.argmax(groups == wanted[:, None, :], axis=1))


def _first(time: Array, values: Array, group: int) -> tuple[Array, Array]:
    ends = values.reshape(-1, group, values.shape[1])[:, [0, -1]]
    return _ends(time, group), ends.reshape(-1, values.shape[1])


def _ends(time: Array, group: int) -> Array:
    return time.reshape(-1, group)[:, [0, -1]].ravel()


APPLICATION: Final = "mavhums"
TIMELINE: Final = "flight_time"

Times = NDArray[np.float64] | Sequence[float]


def open_stream(recording_id: str) -> rr.RecordingStream:
    """Return a stream with the flight timeline and without data of the machine that writes it."""
    import rerun as rr

    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


def nanoseconds(time_s: Times) -> NDArray[np.timedelta64]:
    """Return flight times as Rerun's durations."""
    rounded = np.rint(np.asarray(time_s, dtype=np.float64) * 1e9)
    return rounded.astype(np.int64).astype("timedelta64[ns]")


def send(stream: rr.RecordingStream, path: str, time_s: Times, content: rr.ComponentColumnList) -> None:
    """Write rows of one entity at flight times."""
    import rerun as rr

    index = [rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))]
    stream.send_columns(path, indexes=index, columns=content, strict=True)
