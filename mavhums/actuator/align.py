"""Bring an actuator's sources onto one sample clock.

The clock is the times of the source that carries V5, else V7, else V3, else V1; the other
quantities are interpolated to it. What a sample holds depends on the order of the log alone, however
it was cut into blocks. A sample is settled by the message with which every source that could add to
it has reached its time; at the latest by the first clock sample that lies ``SETTLE_S`` later, and
where the clock fell silent by whatever lies three seconds later. Only what came until then counts.
In the first three seconds nobody knows what sources there are, and ``SETTLE_S`` is waited for.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.readings import Reading
from mavhums.quantities import KEYS, column

__all__ = ["SETTLE_S", "Aligned", "Aligner", "Series"]

SETTLE_S = 0.25
_MAX_SPAN_US = 2_000_000
_KEEP_US = 3_000_000
_LAZY_US = 1_000_000
_SLOPE_US = 80_000
_NEVER = 2**62
_CLOCK_ORDER = tuple(column(key) for key in ("V5", "V7", "V3", "V1"))


class Aligned(NamedTuple):
    """Samples of one actuator on one clock.

    Attributes
    ----------
    utc_us, values
        Shapes (n,) and (n, 12); NaN where no source gives a quantity.
    origin
        Which source each value is from, as an index into ``Aligner.sources``; −1 where none.
    command_rate
        Rate of V1 as it was ``lag`` earlier, °/s, shape (n,); NaN where V1 is not known.
    tier
        Of the source whose times these are.
    signed
        Whether its values have their sign.
    """

    utc_us: NDArray[np.int64]
    values: NDArray[np.float64]
    origin: NDArray[np.int8]
    command_rate: NDArray[np.float64]
    tier: str
    signed: bool


class Series:
    """One source's values, increasing in time; what comes out of order is left out and counted."""

    def __init__(self, first: Reading) -> None:
        self.source, self.tier, self.fields, self.signed = (
            first.source,
            first.tier,
            first.fields,
            first.signed,
        )
        self.time_us = np.empty(0, dtype=np.int64)
        self.frame = np.empty(0, dtype=np.int64)
        self.values = np.empty((0, len(KEYS)))
        self.first_frame = int(first.frame[0])
        self.columns = [column(key) for key in first.fields]
        given = np.isfinite(first.values[0])
        self.clock_rank = next((k for k, c in enumerate(_CLOCK_ORDER) if given[c]), len(_CLOCK_ORDER))
        self.late = 0
        self.latest_us = -_NEVER

    def add(self, reading: Reading) -> NDArray[np.bool_]:
        """Append what is later than all before, and return which rows that were."""
        utc_us, frame, values = reading.utc_us, reading.frame, reading.values
        before = np.concatenate([[self.latest_us], utc_us[:-1]])
        later = utc_us > before
        if not later.all():
            later = utc_us > np.maximum.accumulate(before)
            utc_us, frame, values = utc_us[later], frame[later], values[later]
            self.late += int(np.count_nonzero(~later))
        self.latest_us = max(self.latest_us, int(reading.utc_us.max()))
        self.time_us = np.concatenate([self.time_us, utc_us])
        self.frame = np.concatenate([self.frame, frame])
        self.values = np.concatenate([self.values, values])
        return later

    def forget_before(self, time_us: int) -> None:
        """Drop what is older than ``time_us``, some time later."""
        if self.time_us.size == 0 or self.time_us[0] > time_us - _LAZY_US:
            return
        start = int(np.searchsorted(self.time_us, time_us))
        if start:
            self.time_us, self.frame = self.time_us[start:], self.frame[start:]
            self.values = self.values[start:]

    def reached(self, time_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the frame of the first value at or after each time (n,); ``_NEVER`` where there is none."""
        return np.append(self.frame, _NEVER)[np.searchsorted(self.time_us, time_us)]

    def at(self, time_us: NDArray[np.int64], limit: NDArray[np.int64]) -> NDArray[np.float64]:
        """Interpolate to ``time_us`` (n,) from messages before frames ``limit`` (n,), shape (n, 12)."""
        out = np.full((time_us.size, len(KEYS)), np.nan)
        if self.time_us.size == 0:
            return out
        right = np.searchsorted(self.time_us, time_us)
        known = np.searchsorted(self.frame, limit)
        there = (right < known) & (self.time_us[known - 1] - time_us <= _KEEP_US)
        right = np.minimum(right, self.time_us.size - 1)
        exact = there & (self.time_us[right] == time_us)
        out[exact] = self.values[right[exact]]
        left = right - 1
        span = self.time_us[right] - self.time_us[np.maximum(left, 0)]
        between = there & ~exact & (left >= 0) & (span <= _MAX_SPAN_US)
        a, b = left[between], right[between]
        part = ((time_us[between] - self.time_us[a]) / span[between])[:, None]
        out[between] = self.values[a] * (1.0 - part) + self.values[b] * part
        return out


class Aligner:
    """Aligns the sources of one actuator, block after block.

    Parameters
    ----------
    trust
        Names of the tiers, the best first: where several sources give a quantity, the best is taken.
    lag_s
        By how much the shaft follows the command.

    Attributes
    ----------
    sources
        Those seen so far, in the order of their appearance.
    """

    def __init__(self, trust: Sequence[str], lag_s: float) -> None:
        self.sources: list[Series] = []
        self._trust = {tier: rank for rank, tier in enumerate(trust)}
        self._lag_us = round(lag_s * 1e6)
        self._clock = -1
        self._due = np.empty((3, 0), dtype=np.int64)  # time, frame, source
        self._latest_due_us = -_NEVER
        self._known_from_us = _NEVER

    def feed(self, readings: Iterable[Reading], *, final: bool = False) -> list[Aligned]:
        """Take new readings and return the samples that they settle; ``final`` settles what is left."""
        self._enqueue(list(readings))
        time_us, _, clock = self._due
        limit = self._limits()
        settled = time_us.size if final else int(np.argmax(np.append(limit, _NEVER) == _NEVER))
        bounds = _runs(clock[:settled])
        aligned = [self._align(time_us[a:b], limit[a:b], self.sources[clock[a]]) for a, b in pairwise(bounds)]
        self._due = self._due[:, settled:]
        oldest = int(self._due[0, 0]) if self._due.size else _NEVER
        for series in self.sources:
            series.forget_before(min(oldest, series.latest_us) - _KEEP_US - _MAX_SPAN_US)
        return aligned

    def _limits(self) -> NDArray[np.int64]:
        """Return for each sample that is due the frame from which on nothing counts for it.

        ``_NEVER`` where it is not settled yet.
        """
        time_us, frame, clock = self._due
        settler = np.searchsorted(time_us, time_us + round(SETTLE_S * 1e6))
        limit = np.append(frame, _NEVER)[settler]
        for series in self.sources:
            if time_us.size and series.latest_us >= time_us[0] + _KEEP_US:
                limit = np.minimum(limit, series.reached(time_us + _KEEP_US))
        for a, b in pairwise(_runs(clock)):
            complete = self._completed(time_us[a:b], frame[a:b], int(clock[a]))
            sources_known = time_us[a:b] >= self._known_from_us
            limit[a:b] = np.where(sources_known, np.minimum(limit[a:b], complete + 1), limit[a:b])
        limit[limit > _NEVER] = _NEVER
        return limit

    def _completed(
        self, time_us: NDArray[np.int64], frame: NDArray[np.int64], clock: int
    ) -> NDArray[np.int64]:
        """Return the frame by which every source that could add to a sample has reached its time.

        Such a source had spoken before the sample, and gives what the sample lacks or is trusted more.
        """
        own = self.sources[clock]
        lacking = np.isnan(own.values[np.searchsorted(own.time_us, time_us)])
        complete = frame
        for k, series in enumerate(self.sources):
            better = self._trust[series.tier] < self._trust[own.tier]
            if k == clock or not (better or lacking[:, series.columns].any()):
                continue
            adds = lacking[:, series.columns].any(axis=1) | better
            adds &= frame > series.first_frame
            complete = np.where(adds, np.maximum(complete, series.reached(time_us)), complete)
        return complete

    def _enqueue(self, readings: list[Reading]) -> None:
        """Add readings to their series, and the clock's to the samples that are due."""
        known = {series.source: k for k, series in enumerate(self.sources)}
        added: dict[int, tuple[Reading, NDArray[np.bool_]]] = {}
        reigns = [(self._clock, -1)]
        for reading in sorted(readings, key=lambda reading: int(reading.frame[0])):
            k = known.get(reading.source)
            if k is None:
                if not known:
                    self._known_from_us = int(reading.utc_us[0]) + _KEEP_US
                k = known[reading.source] = len(self.sources)
                self.sources.append(Series(reading))
                if self._clock < 0 or self._rank(k) < self._rank(self._clock):
                    self._clock = k
                    reigns.append((k, int(reading.frame[0])))
            added[k] = reading, self.sources[k].add(reading)
        for (k, start), (_, end) in pairwise([*reigns, (-1, _NEVER)]):
            if k in added:
                reading, rows = added[k]
                rows = rows & (reading.frame >= start) & (reading.frame < end)
                rows &= reading.utc_us > self._latest_due_us
                if rows.any():
                    due = np.stack([reading.utc_us[rows], reading.frame[rows], np.full(rows.sum(), k)])
                    self._due = np.concatenate([self._due, due], axis=1)
                    self._latest_due_us = int(due[0, -1])

    def _rank(self, source: int) -> tuple[int, int]:
        series = self.sources[source]
        return series.clock_rank, self._trust[series.tier]

    def _align(self, time_us: NDArray[np.int64], limit: NDArray[np.int64], clock: Series) -> Aligned:
        values, origin = self._combine(time_us, limit, signed=clock.signed)
        rate = np.full(time_us.size, np.nan)
        if not clock.signed:
            middle = time_us - self._lag_us
            after = self._combine(middle + _SLOPE_US // 2, limit, signed=True)[0][:, 0]
            before = self._combine(middle - _SLOPE_US // 2, limit, signed=True)[0][:, 0]
            rate = (after - before) / (_SLOPE_US * 1e-6)
        return Aligned(time_us, values, origin, rate, clock.tier, clock.signed)

    def _combine(
        self, time_us: NDArray[np.int64], limit: NDArray[np.int64], *, signed: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
        """Return the best source's value of each quantity at each time, and which source that was.

        Magnitudes are not mixed among signed values.
        """
        values = np.full((time_us.size, len(KEYS)), np.nan)
        origin = np.full(values.shape, -1, dtype=np.int8)
        for k in sorted(range(len(self.sources)), key=lambda k: self._trust[self.sources[k].tier]):
            if signed and not self.sources[k].signed:
                continue
            if not np.isnan(values[:, self.sources[k].columns]).any():
                continue
            found = self.sources[k].at(time_us, limit)
            better = np.isnan(values) & np.isfinite(found)
            values[better] = found[better]
            origin[better] = k
        return values, origin


def _runs(clock: NDArray[np.int64]) -> list[int]:
    """Return the bounds of the runs of one clock."""
    return [0, *(np.flatnonzero(np.diff(clock)) + 1).tolist(), clock.size] if clock.size else []
