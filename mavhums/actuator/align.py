"""Alignment of an actuator's sources to one sample clock.

The clock is given by the times of the source that carries V5, else V7, else V3, else V1, and that is
sampled: a current once a second must not thin positions of 20 Hz. The other quantities are interpolated
to it; between values farther apart than a sampled source's, a reading is held, and an angle is not known.

Which values come in time is decided as for a vehicle's signals (:mod:`mavhums.vehicle.arrivals`): a time is
settled when every source has passed it that is not silent for longer than the horizon. The samples before it
are then final, and they rest only on values that came before they were settled. So they depend on the order
of messages in the log, not on its division into blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.telemetry import Reading
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, column
from mavhums.vehicle.arrivals import Arrivals, Order

_ANGLES = [column("V2"), column("V3")]
_HELD = [column(key) for key in KEYS if key not in ("V1", "V2", "V3", "V11")]
"""Quantities that need a sensor; the command and the load need none at the shaft, and are interpolated."""
_MAX_SPAN_US = 2_000_000  # between neighbours that are interpolated: a longer gap hides whole motions
_SAMPLED_US = 500_000  # longest step of a source that is sampled: over more a shaft moves to and fro
_SLOPE_US = 80_000  # over which the command's rate is taken: longer blurs steps
_STEPS_HZ = 8  # of what is settled: the view of a live link is as late, and arrays of few samples are slow
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


@dataclass(slots=True, eq=False)
class Origin:
    """A source of an actuator's values: its message, its tier, and the field of each quantity.

    Attributes
    ----------
    time_us, settled_us, values, loose
        The values that later samples may need: their times, shape (n,), what was settled before they came,
        V1…V12, and whether the latency of the link blurs their time.
    worth
        As a clock, the least one is the best: rank of its quantity, and of its tier; None before any value.
    sampled
        Whether two of its values followed each other soon.
    """

    name: str
    tier: str
    fields: Mapping[str, str]
    signed: bool
    time_us: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    settled_us: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(default_factory=lambda: np.empty((0, len(KEYS))))
    loose: Flags = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    worth: tuple[int, int] | None = None
    sampled: bool = False

    def add(self, reading: Reading, settled_us: Array, loose: Flags) -> None:
        """Add the values that came in time, those whose ``settled_us`` is a number."""
        good = ~np.isnan(settled_us)
        self.time_us = np.concatenate([self.time_us, reading.utc_us[good]])
        self.settled_us = np.concatenate([self.settled_us, settled_us[good]])
        self.values = np.concatenate([self.values, reading.values[good]])
        self.loose = np.concatenate([self.loose, loose[good]])

    def forget(self, before_us: float) -> None:
        """Drop the values before a time, except the last of them."""
        first = max(int(np.searchsorted(self.time_us, before_us)) - 1, 0)
        self.time_us, self.settled_us = self.time_us[first:], self.settled_us[first:]
        self.values, self.loose = self.values[first:], self.loose[first:]

    def at(self, at_us: Integers, sample_us: Integers, *, sharp: bool) -> Array:
        """Return V1…V12 at times (n,) by what was known when the samples at ``sample_us`` were settled.

        With ``sharp``, values whose time is blurred are left out.
        """
        out = np.full((at_us.size, len(KEYS)), np.nan)
        right = np.searchsorted(self.time_us, at_us)
        known = np.flatnonzero(right < self.time_us.size)
        right = right[known]
        left = np.where(self.time_us[right] == at_us[known], right, right - 1)
        span_us = self.time_us[right] - self.time_us[left]
        usable = (left >= 0) & (span_us <= _MAX_SPAN_US) & (self.settled_us[right] <= sample_us[known])
        known, left, right, span_us = known[usable], left[usable], right[usable], span_us[usable]
        part = ((at_us[known] - self.time_us[left]) / np.maximum(span_us, 1))[:, None]
        values = np.where(self.loose[:, None], np.nan, self.values) if sharp else self.values
        found = values[left] * (1.0 - part) + values[right] * part
        apart = np.flatnonzero(span_us > _SAMPLED_US)
        found[apart[:, None], _HELD] = values[left[apart, None], _HELD]
        found[apart[:, None], _ANGLES] = np.nan
        out[known] = found
        return out


class _Turn(NamedTuple):
    """When a source is heard first, or shows that it is sampled."""

    time_us: float
    place: int
    sampled: bool


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
    late
        Number of values that came too late or twice, which are ignored.
    """

    def __init__(self, trust: Sequence[str], lag_s: float) -> None:
        self.sources: list[Origin] = []
        self.late = 0
        self._trust = {tier: rank for rank, tier in enumerate(trust)}
        self._lag_us = round(lag_s * 1e6)
        self._order = Order(_STEPS_HZ)
        self._places: dict[str, int] = {}
        self._turns: list[_Turn] = []
        self._ranks: dict[int, tuple[bool, tuple[int, int] | None]] = {}  # slow or not, and its worth
        self._settled_us = -np.inf

    @property
    def kept(self) -> int:
        """Number of buffered values of all sources."""
        return sum(source.time_us.size for source in self.sources)

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
        self._take(readings, np.empty(0, dtype=np.int64) if loose is None else loose)
        settled_us = np.inf if final else self._order.complete_until_s * 1e6
        if settled_us <= self._settled_us:
            return []
        out = []
        for place, begin_us, end_us in self._reigns(settled_us):
            clock = self.sources[place]
            a, b = np.searchsorted(clock.time_us, [begin_us, end_us])
            if b > a:
                out.append(self._align(place, clock.time_us[a:b], clock.loose[a:b]))
        self._settled_us = settled_us
        for source in self.sources:
            source.forget(settled_us - self._lag_us - _SLOPE_US // 2)
        return out

    def _take(self, readings: Sequence[Reading], loose: Integers) -> None:
        readings = sorted(readings, key=lambda reading: int(reading.frame[0]))
        settled = self._order.feed(
            [Arrivals(reading.source, reading.frame, reading.utc_us / 1e6) for reading in readings]
        )
        for reading, settled_s in zip(readings, settled, strict=True):
            place = self._places.setdefault(reading.source, len(self.sources))
            if place == len(self.sources):
                self.sources.append(Origin(reading.source, reading.tier, reading.fields, reading.signed))
            source = self.sources[place]
            before = source.time_us.size
            source.add(reading, settled_s * 1e6, np.isin(reading.frame, loose))
            added = source.time_us.size - before
            self.late += reading.frame.size - added
            if added:
                self._note(place, added)

    def _note(self, place: int, added: int) -> None:
        """Note from when on a source may be the clock, given how many values it has just added."""
        source = self.sources[place]
        if source.worth is None:
            given = np.isfinite(source.values[-added])
            rank = next((rank for rank, c in enumerate(_CLOCK_ORDER) if given[c]), len(_CLOCK_ORDER))
            source.worth = rank, self._trust[source.tier]
            self._turns.append(_Turn(float(source.time_us[-added]), place, sampled=False))
        if not source.sampled:
            recent = slice(-added - 1, None)
            short = np.flatnonzero(np.diff(source.time_us[recent]) <= _SAMPLED_US)
            if short.size:
                source.sampled = True
                # From the first value of the step on, as far as that was not settled before the second.
                first_us, second_us = (
                    source.time_us[recent][short[0]],
                    source.settled_us[recent][short[0] + 1],
                )
                self._turns.append(_Turn(max(float(first_us), float(second_us)), place, sampled=True))

    def _reigns(self, settled_us: float) -> Iterator[tuple[int, float, float]]:
        """Yield which source is the clock from when to when, up to what is settled now."""
        begin_us = self._settled_us
        due = sorted(turn for turn in self._turns if turn.time_us < settled_us)
        self._turns = [turn for turn in self._turns if turn.time_us >= settled_us]
        for time_us, place, sampled in [*due, _Turn(settled_us, -1, sampled=False)]:
            if self._ranks and time_us > begin_us:
                yield min(self._ranks, key=self._ranks.__getitem__), begin_us, time_us
                begin_us = time_us
            if place >= 0:
                self._ranks[place] = not sampled, self.sources[place].worth

    def _align(self, place: int, time_us: Integers, alone: Flags) -> Aligned:
        clock = self.sources[place]
        values, origin = self._combine(place, time_us, time_us, signed=clock.signed)
        foreign = alone[:, None] & (origin != place)
        values[foreign], origin[foreign] = np.nan, -1
        rate = np.full(time_us.size, np.nan)
        if not clock.signed:
            middle_us = time_us - self._lag_us
            after = self._combine(place, middle_us + _SLOPE_US // 2, time_us, signed=True)[0][:, 0]
            before = self._combine(place, middle_us - _SLOPE_US // 2, time_us, signed=True)[0][:, 0]
            rate = np.where(alone, np.nan, (after - before) / (_SLOPE_US * 1e-6))
        return Aligned(time_us, values, origin, rate, clock.tier, clock.signed)

    def _combine(
        self, clock: int, at_us: Integers, sample_us: Integers, *, signed: bool
    ) -> tuple[Array, NDArray[np.int8]]:
        """Return the best source's value of each quantity at each time, and that source.

        Magnitudes and signed values are not mixed.
        """
        values = np.full((at_us.size, len(KEYS)), np.nan)
        origin = np.full(values.shape, -1, dtype=np.int8)
        for place in sorted(range(len(self.sources)), key=lambda k: self._trust[self.sources[k].tier]):
            source = self.sources[place]
            if signed and not source.signed:
                continue
            found = source.at(at_us, sample_us, sharp=place != clock)
            taken = np.isnan(values) & np.isfinite(found)
            values[taken], origin[taken] = found[taken], place
        return values, origin
