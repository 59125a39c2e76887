"""Alignment of an actuator's sources to one sample clock.

The clock is given by the times of the source that carries V5, else V7, else V3, else V1, and that is
sampled: a current once a second must not thin positions of 20 Hz. The other quantities are interpolated
to it; between values farther apart than a sampled source's, a reading is held, and an angle is not known.
Samples depend only on the order of messages in the log, not on its division into blocks. A sample
becomes final when every source that could contribute to it has reached its time, at the latest with any
message :data:`~mavhums.vehicle.grid.HORIZON_S` later: a late
message is not a lost one. Later messages do not change it. A source that has been silent for as long
is not waited for, and a sample that arrives as far behind another source becomes final without values.
In the first ten seconds every sample waits until all sources have had the time to be heard.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.telemetry import Reading
from mavhums.core.arrays import Array, Array2, Flags, Flags2, Integers, Integers1, Integers2
from mavhums.core.kernels import kernel, subroutine
from mavhums.core.quantities import KEYS, column
from mavhums.vehicle.grid import HORIZON_S

NEVER = 2**62
_BETWEEN = (column("V1"), column("V11"))  # the command and the load, which need no sensor at the shaft
_ANGLES = (column("V2"), column("V3"))

Rows = tuple[Integers1, Integers1, Array2]
"""Times, frames and values of all sources: those of source k from ``bounds[k]`` to ``bounds[k + 1]``,
increasing in time and in frame."""


@subroutine
def _first(values: Integers, start: int, end: int, least: int) -> int:
    """Return the first index from ``start`` on whose value is at least ``least``, else ``end``."""
    return start + int(np.searchsorted(values[start:end], least))


@kernel
def _near(values: Integers1, start: int, end: int, least: int, guess: int) -> int:
    """Return what :func:`_first` returns, at once if it is the guess or the index after the guess."""
    for index in range(max(guess, start), min(guess + 2, end)):
        if values[index] >= least and (index == start or values[index - 1] < least):
            return index
    return _first(values, start, end, least)


@kernel
def limits(
    due: Integers2,
    rows: Rows,
    bounds: Integers1,
    first_frame: Integers1,
    rank: Integers1,
    gives: Flags2,
    horizon_us: int,
    known_from_us: int,
    final: bool,
) -> Integers:
    """Return, for each sample that is final, the first frame that it no longer uses.

    Pending samples, (n, 3), become final in order, all of them if ``final``. The frame is 0 for a
    sample that arrived more than ``horizon_us`` behind a source; it then uses no values at all.
    """
    time, frame, values = rows
    count = len(due)
    out = np.empty(count, dtype=np.int64)
    ahead, own, beside, heard = bounds[:-1].copy(), 0, bounds[:-1].copy(), bounds[:-1].copy()
    opened = NEVER
    for k in range(rank.size):
        row = _first(time, bounds[k], bounds[k + 1], known_from_us)
        opened = min(opened, frame[row] if row < bounds[k + 1] else NEVER)
    for i in range(count):
        at_us, own_frame, clock = due[i]
        limit = NEVER
        for k in range(rank.size):
            row = ahead[k] = _near(time, bounds[k], bounds[k + 1], at_us + horizon_us, ahead[k])
            limit = min(limit, frame[row] if row < bounds[k + 1] else NEVER)
        if limit < own_frame:
            limit = 0
        # Which sources there are is known once they have had the time to be heard.
        asked = own_frame if at_us >= known_from_us else max(own_frame, opened)
        complete = asked
        own = _near(time, bounds[clock], bounds[clock + 1], at_us, own)
        for k in range(rank.size):
            if asked == NEVER or k == clock or asked <= first_frame[k]:
                continue
            adds = rank[k] < rank[clock]
            for j in range(values.shape[1]):
                adds = adds or (gives[k, j] and np.isnan(values[own, j]))
            last = heard[k] = _near(frame, bounds[k], bounds[k + 1], asked + 1, heard[k])
            silent = last > bounds[k] and time[last - 1] < at_us - horizon_us
            if adds and not silent:  # nothing waits for a source that has died
                row = beside[k] = _near(time, bounds[k], bounds[k + 1], at_us, beside[k])
                complete = max(complete, frame[row] if row < bounds[k + 1] else NEVER)
        limit = min(limit, complete + 1)
        if limit >= NEVER and not final:
            return out[:i]
        out[i] = min(limit, NEVER)
    return out


@kernel
def combine(
    at_us: Integers1,
    limit: Integers1,
    order: Integers1,
    rows: Rows,
    bounds: Integers1,
    keep_us: int,
    spans_us: tuple[int, int],
) -> tuple[Array, NDArray[np.int8]]:
    """Return each quantity at each time, from the first source in ``order`` that has it.

    ``spans_us`` are the longest step between neighbours that are interpolated and, of what a servo reports,
    the longest of a source that is sampled: over more a reading is held, so that it shows that it repeats,
    and an angle is not known.
    Only messages before frames ``limit`` (n,) are used. Values and sources (−1 for none) are (n, 12) each.
    """
    time, frame, values = rows
    columns = values.shape[1]
    out = np.full((at_us.size, columns), np.nan)
    origin = np.full((at_us.size, columns), -1, dtype=np.int8)
    rights, knowns = bounds[:-1].copy(), bounds[:-1].copy()
    for i in range(at_us.size):
        missing = columns
        for k in order:
            if missing == 0:
                break
            right = rights[k] = _near(time, bounds[k], bounds[k + 1], at_us[i], rights[k])
            known = knowns[k] = _near(frame, bounds[k], bounds[k + 1], limit[i], knowns[k])
            if right >= known or time[known - 1] - at_us[i] > keep_us:
                continue
            left, part = right, 0.0
            if time[right] != at_us[i]:
                left = right - 1
                if left < bounds[k] or time[right] - time[left] > spans_us[0]:
                    continue
                part = (at_us[i] - time[left]) / (time[right] - time[left])
            sampled = time[right] - time[left] <= spans_us[1]
            for j in range(columns):
                found = values[right, j]
                if not sampled and j not in _BETWEEN:
                    found = np.nan if j in _ANGLES else values[left, j]
                elif left != right:
                    found = values[left, j] * (1.0 - part) + found * part
                if np.isnan(out[i, j]) and np.isfinite(found):
                    out[i, j], origin[i, j] = found, k
                    missing -= 1
    return out, origin


_HORIZON_US = round(HORIZON_S * 1e6)
_OPENING_US = 10_000_000  # in which each type is heard once, whatever its latency or the backlog of the link
_MAX_SPAN_US = 2_000_000  # between neighbours that are interpolated: a longer gap hides whole motions
_SAMPLED_US = 500_000  # longest step of a source that is sampled: over more a shaft moves to and fro
_SLOPE_US = 80_000  # over which the command's rate is taken: longer blurs steps
_CLOCK_ORDER = tuple(column(key) for key in ("V5", "V7", "V3", "V1"))


class Aligned(NamedTuple):
    """Samples of one actuator on one clock.

    Attributes
    ----------
    utc_us, values
        Shapes (n,) and (n, 12); NaN where no source gives a quantity.
    origin
        Source of each value, as an index into ``Aligner.sources``; −1 for none.
    command_rate
        Rate of V1 at a time ``lag`` earlier, °/s, shape (n,); NaN if V1 is unknown.
    tier
        Tier of the source that is the clock.
    signed
        Whether the values of this source are signed.
    """

    utc_us: Integers
    values: Array
    origin: NDArray[np.int8]
    command_rate: Array
    tier: str
    signed: bool


class Origin(NamedTuple):
    """A source of an actuator's values: the message, its tier, and the field of each quantity."""

    source: str
    tier: str
    fields: Mapping[str, str]
    signed: bool


class Aligner:
    """Aligns the sources of one actuator, block after block.

    Parameters
    ----------
    trust
        Names of the tiers, best first: if several sources give a quantity, the best one is used.
    lag_s
        Delay of the shaft behind the command.

    Attributes
    ----------
    sources
        The sources so far, in order of first appearance.
    """

    def __init__(self, trust: Sequence[str], lag_s: float) -> None:
        self.sources: list[Origin] = []
        self._trust = {tier: rank for rank, tier in enumerate(trust)}
        self._lag_us = round(lag_s * 1e6)
        self._places: dict[str, int] = {}
        self._clock = -1
        self._worth: list[tuple[int, int]] = []  # as a clock: rank of the quantity, and of the tier
        self._ranks: dict[int, tuple[bool, int, int]] = {}  # whether a source is slow, and its worth
        self._sampled: set[int] = set()
        self._known_from_us = NEVER
        none: Integers = np.empty(0, dtype=np.int64)
        self._rows: Rows = none, none, np.empty((0, len(KEYS)))
        self._bounds = np.zeros(1, dtype=np.int64)
        self._latest_us, self._late, self._first_frame, self._rank = none, none, none, none
        self._gives = np.empty((0, len(KEYS)), dtype=np.bool_)
        self._by_trust = {True: none, False: none}
        self._due = np.empty((0, 3), dtype=np.int64)  # time, frame, source
        self._latest_due_us = -NEVER
        self._loose = none  # frames

    @property
    def late(self) -> int:
        """Number of out-of-order or repeated values, which are ignored."""
        return int(self._late.sum())

    @property
    def kept(self) -> int:
        """Number of buffered values of all sources."""
        return self._rows[0].size

    def feed(
        self,
        readings: Sequence[Reading],
        *,
        loose: Integers | None = None,
        final: bool = False,
    ) -> list[Aligned]:
        """Add new readings, at most one per source, and return the samples that become final.

        ``loose`` are the frames of messages whose time the latency of the link blurs: their values hold, but
        are not combined with those of other sources. With ``final``, all remaining samples become final.
        """
        if readings:
            if loose is not None and loose.size:
                self._loose = np.concatenate([self._loose, loose])
            self._take(readings)
        limit = limits(
            self._due, self._rows, self._bounds, self._first_frame, self._rank, self._gives,
            _HORIZON_US, self._known_from_us, final,
        )  # fmt: skip
        time_us, frame, clock = np.ascontiguousarray(self._due[: limit.size].T)
        alone = np.isin(frame, self._loose)
        self._due = self._due[limit.size :]
        self._loose = self._loose[self._loose >= self._due[:1, 1].min(initial=NEVER)]
        edges = [0, *(np.flatnonzero(np.diff(clock)) + 1).tolist(), clock.size]
        return [
            self._align(time_us[a:b], limit[a:b], alone[a:b], int(clock[a]))
            for a, b in pairwise(edges)
            if b > a
        ]

    def _take(self, readings: Sequence[Reading]) -> None:
        """Add readings to the rows of their sources, and the clock's rows to the pending samples."""
        turns: list[tuple[int, int, bool]] = []  # frame, source, and whether it is slow from there on
        new: dict[int, Reading] = {}
        for reading in sorted(readings, key=lambda reading: int(reading.frame[0])):
            k = self._places.get(reading.source)
            if k is None:
                k = self._introduce(reading)
                turns.append((int(reading.frame[0]), k, False))
            new[k] = reading
            if k in self._sampled:
                continue
            # A source is slow from its first step on if that is long, until a short one.
            step_us = reading.utc_us - np.maximum.accumulate([self._latest_us[k], *reading.utc_us[:-1]])
            known = np.flatnonzero((step_us > 0) & (step_us < NEVER))
            short = known[step_us[known] <= _SAMPLED_US][:1]
            if short.size:
                self._sampled.add(k)
            turns += [(int(reading.frame[i]), k, i not in short) for i in {*known[:1], *short}]
        reigns = [(self._clock, -1)]
        for frame, k, slow in sorted(turns):
            self._ranks[k] = slow, *self._worth[k]
            best = min(self._ranks, key=lambda place: self._ranks[place])
            if best != self._clock:
                self._clock = best
                reigns.append((best, frame))
        new = {k: self._sharp(k, reading, np.array(reigns)) for k, reading in new.items()}
        self._join(new, reigns)

    def _join(self, new: Mapping[int, Reading], reigns: Sequence[tuple[int, int]]) -> None:
        """Join old and new rows, and append the clock's new rows to the pending samples.

        ``reigns`` lists sources, and the frame from which on each is the clock. Old rows that no sample can
        need are dropped, except the last of each source: those earlier than all pending and future samples
        and the slope before them, or much earlier than these and the source's latest row. New rows are
        dropped, and counted as late, if they are not later than all earlier ones.
        """
        oldest_us = int(self._due[0, 0]) if len(self._due) else NEVER
        needed_us = min(oldest_us, self._latest_due_us) - self._lag_us - _SLOPE_US // 2
        parts: list[list[NDArray[Any]]] = []
        fresh: dict[int, Rows] = {}
        for k, (a, b) in enumerate(pairwise(self._bounds.tolist())):
            least_us = max(needed_us, min(oldest_us, int(self._latest_us[k])) - _HORIZON_US - _MAX_SPAN_US)
            first = max(a + int(np.searchsorted(self._rows[0][a:b], least_us)) - 1, a)
            rows: list[NDArray[Any]] = [part[first:b] for part in self._rows]
            if k in new:
                time_us = new[k].utc_us
                latest_us = np.maximum.accumulate(np.append(self._latest_us[k], time_us))
                later = time_us > latest_us[:-1]
                self._latest_us[k] = latest_us[-1]
                self._late[k] += np.count_nonzero(~later)
                fresh[k] = time_us[later], new[k].frame[later], new[k].values[later]
                rows = [np.concatenate(pair) for pair in zip(rows, fresh[k], strict=True)]
            parts.append(rows)
        time_us, frame, values = map(np.concatenate, zip(*parts, strict=True))
        self._rows = time_us, frame, values
        self._bounds = np.array([0, *accumulate(len(part[0]) for part in parts)])
        for (k, begin), (_, end) in pairwise([*reigns, (-1, NEVER)]):
            if k in fresh:
                time_us, frame, _ = fresh[k]
                chosen = (begin <= frame) & (frame < end) & (time_us > self._latest_due_us)
                source = np.full(np.count_nonzero(chosen), k)
                self._due = np.vstack([self._due, np.column_stack([time_us[chosen], frame[chosen], source])])
                self._latest_due_us = int(self._due[-1, 0]) if len(self._due) else self._latest_due_us

    def _sharp(self, k: int, reading: Reading, reigns: Integers) -> Reading:
        """Return the reading without the values of blurred times, but where its source is the clock."""
        blurred = np.isin(reading.frame, self._loose)
        if not blurred.any():
            return reading
        clock = reigns[np.searchsorted(reigns[:, 1], reading.frame, side="right") - 1, 0]
        blurred &= clock != k
        return reading._replace(values=np.where(blurred[:, None], np.nan, reading.values))

    def _introduce(self, reading: Reading) -> int:
        """Add a source, and return its index."""
        k = self._places[reading.source] = len(self.sources)
        if k == 0:
            self._known_from_us = int(reading.utc_us[0]) + _OPENING_US
        self.sources.append(Origin(reading.source, reading.tier, reading.fields, reading.signed))
        given = np.isfinite(reading.values[0])
        first = next((rank for rank, c in enumerate(_CLOCK_ORDER) if given[c]), len(_CLOCK_ORDER))
        self._worth.append((first, self._trust[reading.tier]))
        self._bounds = np.append(self._bounds, self._bounds[-1])
        self._latest_us, self._late = np.append(self._latest_us, -NEVER), np.append(self._late, 0)
        self._first_frame = np.append(self._first_frame, reading.frame[0])
        self._rank = np.append(self._rank, self._trust[reading.tier])
        self._gives = np.vstack([self._gives, [key in reading.fields for key in KEYS]])
        by_trust = np.argsort(self._rank, kind="stable")
        signed = np.array([source.signed for source in self.sources])
        self._by_trust = {True: by_trust[signed[by_trust]], False: by_trust}
        return k

    def _align(self, time_us: Integers, limit: Integers, alone: Flags, place: int) -> Aligned:
        clock = self.sources[place]
        values, origin = self._combine(time_us, limit, signed=clock.signed)
        foreign = alone[:, None] & (origin != place)
        values[foreign], origin[foreign] = np.nan, -1
        rate = np.full(time_us.size, np.nan)
        if not clock.signed:
            middle = time_us - self._lag_us
            after = self._combine(middle + _SLOPE_US // 2, limit, signed=True)[0][:, 0]
            before = self._combine(middle - _SLOPE_US // 2, limit, signed=True)[0][:, 0]
            rate = np.where(alone, np.nan, (after - before) / (_SLOPE_US * 1e-6))
        return Aligned(time_us, values, origin, rate, clock.tier, clock.signed)

    def _combine(self, time_us: Integers, limit: Integers, *, signed: bool) -> tuple[Array, NDArray[np.int8]]:
        """Return the best source's value of each quantity at each time, and that source.

        Magnitudes and signed values are not mixed.
        """
        by_trust = self._by_trust[signed]
        spans_us = _MAX_SPAN_US, _SAMPLED_US
        return combine(time_us, limit, by_trust, self._rows, self._bounds, _HORIZON_US, spans_us)
