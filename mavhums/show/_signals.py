"""Rows over flight time in a Rerun stream: the quantities of an actuator, and what a network says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any, Final, Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.core.quantities import KEYS
from mavhums.health.decision.events import Classified, Window
from mavhums.results.verdict import ABSTAINED, OUTSIDE
from mavhums.show.curves import Thinner
from mavhums.show.words import BLUE, COLOURS, PALE_BLUE, SERIES, STALE_COLOUR

APPLICATION: Final = "mavhums"
ARCHETYPE: Final = "mavhums"
TIMELINE: Final = "flight_time"
ROWS_PER_CHUNK: Final = 4096

_CAPACITY: Final = 32768
_GAP_S: Final = 3.0

Times = NDArray[np.float64] | Sequence[float]
Columns = Callable[..., rr.ComponentColumnList]
Draw = Callable[[Array, Array], None]
_Key = tuple[str, Columns, tuple[str, ...]]


def open_stream(recording_id: str) -> rr.RecordingStream:
    """Return a stream with the flight timeline and without data of the machine that writes it."""
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


class RowWriter:
    """Writes rows at flight times to a stream, in chunks: a chunk costs more than its rows.

    Parameters
    ----------
    stream
        The recording.
    live
        Whether a viewer follows: it shows each row as it comes, and a recording of a long flight fewer ones.
    """

    def __init__(self, stream: rr.RecordingStream, *, live: bool) -> None:
        self._stream, self.live = stream, live
        self._thinned: list[tuple[Thinner, Draw]] = []
        self._waiting: dict[_Key, list[tuple[Times, dict[str, Any]]]] = {}
        self._sizes: Counter[_Key] = Counter()

    def style(self, path: str, content: rr.AsComponents) -> None:
        """Write what holds for the whole flight."""
        self._stream.log(path, content, static=True)

    def put(self, path: str, time_s: Times, kind: Columns, **columns: Any) -> None:
        """Add rows of an entity; ``kind`` makes Rerun's columns of them, as ``rr.Scalars.columns``."""
        key = (path, kind, tuple(columns))
        self._waiting.setdefault(key, []).append((time_s, columns))
        self._sizes[key] += len(time_s)
        if self._sizes[key] >= ROWS_PER_CHUNK:
            self._write(key)

    def thinned(
        self, columns: int, capacity: int, draw: Draw, keep: Literal["extremes", "first"] = "extremes"
    ) -> Draw:
        """Return what takes times and rows that ``draw`` draws: as they come, or thinned at the end."""
        if self.live:
            return draw
        thinner = Thinner(columns, capacity, keep)
        self._thinned.append((thinner, draw))
        return thinner.add

    def finish(self) -> None:
        """Write all that is left."""
        for thinner, draw in self._thinned:
            time, rows = thinner.rows()
            if time.size:
                draw(time, rows)
        self.flush()

    def flush(self) -> None:
        """Write the rows that wait."""
        for key in [*self._waiting]:
            self._write(key)

    def _write(self, key: _Key) -> None:
        path, kind, names = key
        waiting, self._sizes[key] = self._waiting.pop(key), 0
        time_s = np.concatenate([np.asarray(time, dtype=np.float64) for time, _ in waiting])
        nanoseconds = np.rint(time_s * 1e9).astype(np.int64).astype("timedelta64[ns]")
        joined = {name: _joined([columns[name] for _, columns in waiting]) for name in names}
        for start in range(0, time_s.size, ROWS_PER_CHUNK):
            rows = slice(start, start + ROWS_PER_CHUNK)
            index = [rr.TimeColumn(TIMELINE, duration=nanoseconds[rows])]
            content = kind(**{name: values[rows] for name, values in joined.items()})
            self._stream.send_columns(path, indexes=index, columns=content, strict=True)


def _joined(parts: list[Any]) -> Any:
    return np.concatenate(parts) if isinstance(parts[0], np.ndarray) else [*chain.from_iterable(parts)]


class _Gaps:
    """Ends a line where nothing comes for three seconds, or for three times as long as usual."""

    def __init__(self) -> None:
        self._last_s: float | None = None

    def marked(self, time: Array, values: Array) -> tuple[Array, Array]:
        """Return rows, with one of NaN just after the last row before each gap; block by block."""
        steps = np.diff(time, prepend=time[0] if self._last_s is None else self._last_s)
        self._last_s = float(time[-1])
        gaps = np.flatnonzero(steps > max(_GAP_S, 3 * float(np.median(steps))))
        ends = time[gaps] - steps[gaps] + 1e-3
        return np.insert(time, gaps, ends), np.insert(values, gaps, np.nan, axis=0)


class Signals:
    """Writes the quantities of one actuator.

    A recording is thinned so that each group keeps every quantity's smallest and largest value.

    Parameters
    ----------
    rows, path
        The recording, and the entity path.
    moved
        Is called with the same times and values, for the surface that they move.

    Attributes
    ----------
    present
        Quantities with at least one value.
    """

    def __init__(self, rows: RowWriter, path: str, moved: Draw) -> None:
        self.present: set[str] = set()
        self._rows, self._path, self._moved, self._gaps = rows, path, moved, _Gaps()
        self._take = rows.thinned(len(KEYS), _CAPACITY, self._draw)

    def add(self, time_s: Array, values: Array) -> None:
        """Add samples: times of shape (n,) with n > 0, and values of shape (n, 12), NaN where not given."""
        self.present |= {KEYS[k] for k in np.flatnonzero(np.isfinite(values).any(axis=0)).tolist()}
        self._take(time_s, values)

    def _draw(self, time: Array, values: Array) -> None:
        self._moved(time, values)
        time, values = self._gaps.marked(time, values)
        columns = {key: values[:, place] for place, key in enumerate(KEYS) if key in self.present}
        if columns:
            self._rows.put(self._path, time, _quantities, **columns)


def _quantities(**columns: Array) -> rr.ComponentColumnList:
    components = {key: rr.components.ScalarBatch(values) for key, values in columns.items()}
    return rr.DynamicArchetype.columns(ARCHETYPE, components=components)


_OF_WINDOWS: Final = rr.SeriesLines(names="of ten seconds", colors=BLUE, widths=2.5)
_OF_SAMPLES: Final = rr.SeriesLines(
    names="of each sample",
    colors=PALE_BLUE,
    widths=0.75,
    aggregation_policy=rr.components.AggregationPolicy.MinMax,  # the mean of a pixel would be no class
)


class Classes:
    """Writes what a network says: the probability of an emergency in each sample, and of each window.

    A recording of a long flight is thinned to the extremes of the probability. A class is written where it
    changes.

    Parameters
    ----------
    rows, path
        The recording, and the entity path of the network's windows; samples and classes lie under it.

    Attributes
    ----------
    any
        Whether a sample or a window was classified.
    """

    def __init__(self, rows: RowWriter, path: str) -> None:
        self.any = self._styled = False
        self._rows, self._path, self._gaps = rows, path, _Gaps()
        self._take = rows.thinned(1, _CAPACITY, self._draw)
        self._known: list[str] = []
        self._last = ""

    def add(self, event: Classified) -> None:
        """Add what a network says of each sample."""
        answered = event.inside & (event.said >= 0)
        if answered.any() and not self._styled:
            self.any = self._styled = True
            self._rows.style(f"{self._path}/samples", _OF_SAMPLES)
        if self._styled and event.time_s.size:
            self._take(event.time_s, np.where(answered, event.p_emergency, np.nan)[:, None])

    def _draw(self, time: Array, values: Array) -> None:
        time, values = self._gaps.marked(time, values)
        self._rows.put(f"{self._path}/samples", time, rr.Scalars.columns, scalars=values)

    def add_window(self, event: Window) -> None:
        """Write the class of a window and the probability of a fault in it, at its middle.

        A window about which no network was asked has no class.
        """
        self.any |= event.network is not None
        if not self.any:
            return
        state, path, middle_s = event.network or ABSTAINED, self._path, (event.start_s + event.end_s) / 2
        if not self._known:
            self._rows.style(path, _OF_WINDOWS)
        if state not in self._known:
            self._known.append(state)
            self._rows.style(f"{path}/class", _states(self._known))
        if state != self._last:
            self._rows.put(f"{path}/class", [middle_s], rr.StateChange.columns, state=[state])
        unknown, self._last = event.p_fault is None or state == OUTSIDE, state
        self._rows.put(path, [middle_s], rr.Scalars.columns, scalars=[np.nan if unknown else event.p_fault])


def _states(names: list[str]) -> rr.StateConfiguration:
    """Return labels and colours of classes: those of the conditions, else one of its own each."""
    others = iter(SERIES * len(names))
    known = {str(name): rgb for name, rgb in COLOURS.items()}
    known |= {f"friction_{name}": rgb for name, rgb in known.items()}
    known |= {ABSTAINED: STALE_COLOUR, OUTSIDE: STALE_COLOUR}
    colours = [known.get(name) or next(others) for name in names]
    return rr.StateConfiguration(values=names, labels=names, colors=[(*rgb, 255) for rgb in colours])
