"""Rows over flight time in a Rerun stream: the quantities of an actuator, and what a network says of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Integers
from mavhums.core.quantities import KEYS
from mavhums.health.decision.events import Classified
from mavhums.results.verdict import ABSTAINED, OUTSIDE
from mavhums.show.evidence import Thinner
from mavhums.show.words import COLOURS, PALE_BLUE, SERIES, STALE_COLOUR

APPLICATION: Final = "mavhums"
TIMELINE: Final = "flight_time"

Times = NDArray[np.float64] | Sequence[float]


def open_stream(recording_id: str) -> rr.RecordingStream:
    """Return a stream with the flight timeline and without data of the machine that writes it."""
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
    index = [rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))]
    stream.send_columns(path, indexes=index, columns=content, strict=True)


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
        self._write_ended(float(time_s[-1]))
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
        self._write_ended(np.inf)
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

    def _write_ended(self, latest_s: float) -> None:
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


_STYLE: Final = rr.SeriesLines(
    names="of each sample",
    colors=PALE_BLUE,
    widths=0.75,
    aggregation_policy=rr.components.AggregationPolicy.MinMax,  # the mean of a pixel would be no class
)


class Classes:
    """Writes the probability of an emergency and the class of each sample, and the class of each window.

    All samples of a flight up to 32,768 are written; of a longer one groups of neighbours keep their smallest
    and largest value, so that no other class within a group is lost. A class is written where it changes.

    Parameters
    ----------
    stream, path
        Output stream, and the entity path of the network's windows; samples and classes lie under it.
    live
        Whether a viewer shows the flight live: every sample is then written at the next :meth:`flush`.

    Attributes
    ----------
    any
        Whether a sample or a window was classified.
    """

    def __init__(self, stream: rr.RecordingStream, path: str, *, live: bool) -> None:
        self.any = False
        self._stream, self._path, self._live = stream, path, live
        self._names: list[str] = [ABSTAINED]
        self._lane = _Lane(stream, f"{path}/class/samples")
        self._of_windows = _Lane(stream, f"{path}/class/windows")
        self._thinner = Thinner(2, 4 if live else _CAPACITY)
        self._recent: list[tuple[Array, Array]] = []
        self._drawn = False

    def add(self, event: Classified) -> None:
        """Add samples; outside the network's training range it abstains."""
        if not event.time_s.size or not (self.any or (event.said >= 0).any()):
            return
        self.any = True
        self._names += [name for name in event.classes if name not in self._names]
        codes = np.array([*map(self._names.index, event.classes), 0])[event.said]
        answered = event.inside & (event.said >= 0)
        rows = np.column_stack([np.where(answered, event.p_emergency, np.nan), np.where(answered, codes, 0)])
        if self._live:
            self._recent.append((event.time_s, rows))
        else:
            self._thinner.add(event.time_s, rows)

    def add_windows(self, time: Sequence[float], said: Sequence[str | None]) -> None:
        """Write the class of windows, at their middle; one about which no network was asked is no class."""
        self.any |= any(said)
        if self.any:
            names = sorted({name or ABSTAINED for name in said})
            codes = np.array([names.index(name or ABSTAINED) for name in said])
            self._of_windows.write(np.array(time), names, codes)

    def flush(self) -> None:
        """Write new samples for a live viewer."""
        recent, self._recent = self._recent, []
        if recent:
            self._write(*(np.concatenate(parts) for parts in zip(*recent, strict=True)))

    def finish(self) -> None:
        """Write the remaining samples."""
        self.flush()
        if self.any and not self._live:
            self._write(*self._thinner.rows())

    def _write(self, time: Array, rows: Array) -> None:
        if not self._drawn:
            self._drawn = True
            self._stream.log(f"{self._path}/samples", _STYLE, static=True)
        self._lane.write(time, self._names, rows[:, 1].astype(np.int64))
        gaps = np.flatnonzero(np.diff(time) > _GAP_S).astype(np.int64)
        shown = np.insert(rows[:, 0], gaps + 1, np.nan)
        at_s = np.insert(time, gaps + 1, time[gaps] + 1e-3)
        send(self._stream, f"{self._path}/samples", at_s, rr.Scalars.columns(scalars=shown))


class _Lane:
    """Writes classes where they change, and their colours when a new one comes."""

    def __init__(self, stream: rr.RecordingStream, path: str) -> None:
        self._stream, self._path = stream, path
        self._known: list[str] = []
        self._last = ""

    def write(self, time: Array, names: Sequence[str], codes: Integers) -> None:
        """Write the class of each time: ``codes`` are indices into ``names``, shape (n,)."""
        said = np.array(names)[codes]
        turns = np.flatnonzero(said != np.concatenate([[self._last], said[:-1]]))
        if not turns.size:
            return
        states = said[turns].tolist()
        if not set(names) <= set(self._known):
            self._known += [name for name in names if name not in self._known]
            self._stream.log(self._path, _states(self._known), static=True)
        self._last = states[-1]
        send(self._stream, self._path, time[turns], rr.StateChange.columns(state=states))


def _states(names: list[str]) -> rr.StateConfiguration:
    others = iter(SERIES * len(names))
    known = {str(name): rgb for name, rgb in COLOURS.items()}
    known |= {f"friction_{name}": rgb for name, rgb in known.items()}
    known |= {ABSTAINED: STALE_COLOUR, OUTSIDE: STALE_COLOUR}
    colours = [known.get(name) or next(others) for name in names]
    return rr.StateConfiguration(values=names, labels=names, colors=[(*rgb, 255) for rgb in colours])
