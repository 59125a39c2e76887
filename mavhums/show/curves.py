"""Curves of a flight, gathered from the engine's events in bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import Classified, Indication, Trace, Window
from mavhums.results.verdict import OUTSIDE
from mavhums.show.event_words import drawn

_POINTS: Final = 1200
_CURVES: Final = 256
_FIRST, _LAST = 20, 40
_BATCH: Final = 4096

_Name = TypeVar("_Name")


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


class CurveKey(NamedTuple):
    """Whose evidence a curve shows, and of which fault."""

    vehicle: int
    actuator: str
    fault: str


class Curve(NamedTuple):
    """A fault indicator over flight time.

    Attributes
    ----------
    time_s
        Ends of its windows, shape (n,).
    rows
        Lower bound, value and upper bound of the 95 % interval, shape (n, 3).
    demanded
        What the value is compared with, shape (n,), NaN where it is not known; None of an indicator.
    samples
        Times and values of single samples that the value sums up, shape (2, m); None of an indicator.
    """

    time_s: Array
    rows: Array
    demanded: Array | None = None
    samples: Array | None = None


class EvidenceCollector:
    """Takes the engine's events and keeps what a page shows of them.

    Curves keep every extreme: groups of neighbouring windows are replaced by their smallest and largest
    values. Of very many curves the first 256 are kept, of very many texts the first 20 and the last 40.

    Attributes
    ----------
    texts
        Number of texts in the flight.
    references_s
        Flight seconds from and to which an axis's reference was learned, by vehicle and axis.

    Examples
    --------
    >>> gathered = EvidenceCollector()
    >>> gathered.consume([Notice(1.0, 1, "ArduPlane V4.6.0")])
    >>> [notice.text for notice in gathered.notices()]
    ['ArduPlane V4.6.0']
    """

    def __init__(self) -> None:
        self.texts = 0
        self._thinners: dict[CurveKey, Thinner] = {}
        self._traces: dict[CurveKey, Thinner] = {}
        self.references_s: dict[tuple[int, str], tuple[int, int]] = {}
        self._samples: dict[tuple[int, str], Thinner] = {}
        self._votes: dict[tuple[int, str], Thinner] = {}
        self._first: list[Notice] = []
        self._last: deque[Notice] = deque(maxlen=_LAST)

    def consume(self, events: Iterable[Event]) -> None:
        """Take what the engine reports, in its order."""
        for event in events:
            if isinstance(event, Indication) and event.end_s.size:
                rows = np.column_stack([event.low, event.value, event.high])
                known = np.isfinite(rows).all(axis=1)
                key = CurveKey(event.vehicle, event.actuator, event.fault)
                _add(self._thinners, key, event.end_s[known], rows[known])
            elif isinstance(event, Trace):
                key = CurveKey(event.vehicle, event.actuator, event.kind)
                _add(self._traces, key, event.time_s, drawn(event))
                if event.reference_s and key in self._traces:
                    self.references_s[key[:2]] = event.reference_s
            elif isinstance(event, Classified | Window):
                self._network(event)
            elif isinstance(event, Notice):
                self._notice(event)

    def curves(self) -> dict[CurveKey, Curve]:
        """Return the curves, without empty ones."""
        found = {}
        for key, thinner in self._thinners.items():
            time_s, rows = thinner.rows()
            found[key] = Curve(time_s, np.sort(rows, axis=1))
        return found

    def traces(self) -> dict[CurveKey, Curve]:
        """Return what lies behind the judgements, by its kind in place of a fault."""
        found = {}
        for key, thinner in self._traces.items():
            time_s, values = thinner.rows()
            found[key] = Curve(time_s, np.repeat(values[:, 1:], 3, axis=1), values[:, 0])
        return found

    def networks(self) -> dict[tuple[int, str], Curve]:
        """Return, by vehicle and actuator, the probability of a fault in windows, and in samples."""
        found = {}
        for key, thinner in self._samples.items():
            samples = _finite(*thinner.rows())
            votes = _finite(*self._votes[key].rows()) if key in self._votes else samples
            if votes.size and samples.size:
                found[key] = Curve(votes[0], np.repeat(votes[1][:, None], 3, axis=1), samples=samples)
        return found

    def notices(self) -> list[Notice]:
        """Return the texts that are kept, in their order."""
        return [*self._first, *self._last]

    def _network(self, event: Classified | Window) -> None:
        if isinstance(event, Classified):
            kept, time_s = self._samples, event.time_s
            values = np.where(event.inside, event.p_emergency, np.nan)
        elif event.p_fault is not None and event.network != OUTSIDE:
            kept, time_s = self._votes, np.array([(event.start_s + event.end_s) / 2])
            values = np.array([event.p_fault])
        else:
            return
        _add(kept, (event.vehicle, event.actuator), time_s, values[:, None])

    def _notice(self, event: Notice) -> None:
        self.texts += 1
        (self._first if len(self._first) < _FIRST else self._last).append(event)


def _add(kept: dict[_Name, Thinner], key: _Name, time_s: Array, rows: Array) -> None:
    """Add rows to a curve; of very many curves the first ones are kept."""
    if key not in kept and len(kept) < _CURVES:
        kept[key] = Thinner(rows.shape[1], _POINTS)
    if key in kept:
        kept[key].add(time_s, rows)


def _finite(time_s: Array, values: Array) -> Array:
    """Return times and values without gaps, shape (2, m)."""
    known = np.isfinite(values[:, 0])
    return np.stack([time_s[known], values[known, 0]])
