"""V1…V12 of one actuator, written in full or, for a long flight, thinned."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np
import rerun as rr

from mavhums.core.arrays import Array
from mavhums.core.quantities import KEYS
from mavhums.show._stream import send
from mavhums.show._thin import Thinner

__all__ = ["ARCHETYPE", "Signals"]

ARCHETYPE: Final = "mavhums"

_CAPACITY: Final = 32768
_ROWS_PER_CHUNK: Final = 4096
_RECENT_S, _RECENT_ROWS = 60.0, 20000
_WINDOWS: Final = 20
_GAP_S: Final = 3.0
_NOTHING: Final = np.full((1, len(KEYS)), np.nan)


class Signals:
    """Writes the quantities of one actuator.

    A recording has all samples of a flight up to 32,768; a longer flight is thinned such that every peak is
    kept, with all samples in the windows marked by :meth:`mark`.

    Parameters
    ----------
    stream, path
        Output stream and entity path.
    live
        Whether a viewer shows the flight live: every sample is then written at the next :meth:`flush`.
    moved
        Called with the written times (n,) and values (n, 12), to move the actuator's surface.

    Attributes
    ----------
    present
        Quantities with data so far.
    """

    def __init__(
        self, stream: rr.RecordingStream, path: str, *, live: bool, moved: Callable[[Array, Array], None]
    ) -> None:
        self.present: set[str] = set()
        self._stream, self._path, self._live, self._moved = stream, path, live, moved
        self._written: set[str] = set()
        self._written_s: float | None = None
        self._thinner = Thinner(len(KEYS), 4 if live else _CAPACITY)
        self._recent: deque[tuple[Array, Array]] = deque()
        self._recent_rows = 0
        self._pending: list[tuple[float, float]] = []
        self._whole: list[tuple[float, float]] = []
        self._marked_s = -np.inf

    def add(self, time_s: Array, values: Array) -> None:
        """Add samples: increasing times of shape (n,), values V1…V12 of shape (n, 12)."""
        self.present |= _given(values)
        self._recent.append((time_s, values))
        self._recent_rows += time_s.size
        if self._live:
            return
        self._thinner.add(time_s, values)
        self._settle(float(time_s[-1]))
        while self._recent_rows > _RECENT_ROWS or self._recent[0][0][-1] < time_s[-1] - _RECENT_S:
            if len(self._recent) == 1:
                break
            self._recent_rows -= self._recent.popleft()[0].size

    def mark(self, start_s: float, end_s: float) -> None:
        """Keep every sample from ``start_s`` to ``end_s`` that is still buffered."""
        start_s = max(start_s, self._marked_s)
        if not self._live and end_s > start_s and len(self._whole) + len(self._pending) < _WINDOWS:
            self._pending.append((start_s, end_s))
            self._marked_s = end_s

    def flush(self) -> None:
        """Write new samples for a live viewer."""
        if self._live and self._recent:
            self._write(*self._joined())
            self._recent.clear()
            self._recent_rows = 0

    def finish(self) -> None:
        """Write the remaining samples."""
        self.flush()
        if self._live:
            return
        self._settle(np.inf)
        time, values = self._thinner.rows()
        alone = np.ones(time.size, dtype=np.bool_)
        for start_s, end_s in self._whole:
            inside = (time >= start_s) & (time < end_s)
            if self._thinner.group > 1:
                pairs = inside[: time.size // 2 * 2].reshape(-1, 2)
                inside[: pairs.size] = pairs.all(axis=1).repeat(2)
            alone &= ~inside
        edges = np.flatnonzero(np.diff(alone.astype(np.int8), prepend=0, append=0))
        for begin, end in edges.reshape(-1, 2).tolist():
            self._write(time[begin:end], values[begin:end])

    def _settle(self, latest_s: float) -> None:
        """Write the marked windows that have ended."""
        for window in [window for window in self._pending if window[1] <= latest_s]:
            self._pending.remove(window)
            if not self._recent:
                continue
            time, values = self._joined()
            rows = (time >= window[0]) & (time < window[1])
            if rows.any():
                self._write(time[rows], values[rows])
                self._whole.append((float(time[rows][0]), window[1]))

    def _joined(self) -> tuple[Array, Array]:
        time = np.concatenate([part for part, _ in self._recent])
        return time, np.concatenate([part for _, part in self._recent])

    def _write(self, time: Array, values: Array) -> None:
        """Write rows, and an empty row at each gap, so that no line crosses it."""
        self._moved(time, values)
        if self._written_s is not None:
            time, values = np.append(self._written_s, time), np.vstack([_NOTHING, values])
        steps = np.diff(time)
        gaps = np.flatnonzero(steps > max(_GAP_S, 3 * float(np.median(steps)))) if steps.size else steps[:0]
        gaps = gaps.astype(np.int64)
        time = np.insert(time, gaps + 1, time[gaps] + 1e-3)
        values = np.insert(values, gaps + 1, np.nan, axis=0)
        if self._written_s is not None:
            time, values = time[1:], values[1:]
        if self._live:
            self._written_s = float(time[-1])
        for start in range(0, time.size, _ROWS_PER_CHUNK):
            rows = slice(start, start + _ROWS_PER_CHUNK)
            self._write_chunk(time[rows], values[rows])

    def _write_chunk(self, time: Array, values: Array) -> None:
        self._written |= _given(values)
        columns = {
            key: rr.components.ScalarBatch(values[:, place])
            for place, key in enumerate(KEYS)
            if key in self._written
        }
        if columns:
            content = rr.DynamicArchetype.columns(ARCHETYPE, components=columns)
            send(self._stream, self._path, time, content)


def _given(values: Array) -> set[str]:
    """Return the quantities with data in any of the rows."""
    return {KEYS[place] for place in np.flatnonzero(np.isfinite(values).any(axis=0)).tolist()}
