"""Resamples the signals of one vehicle on an even time grid, in whole seconds, whatever the block size.

Messages of one type arrive in the order in which they were sent, but each type with a latency of its own. So
a sample is late only if it is not later than its stream's earlier ones, or if its second has been settled:
that needs every stream heard within :data:`HORIZON_S` to have passed the second. The stream that lags
most decides, but not by more than the horizon, which bounds what is kept. Samples that come later are
counted and ignored, so a settled second does not depend on how the log was cut into blocks. Between samples a
signal is interpolated; over a gap of more than :data:`GAP_S` it is NaN. Several messages that carry one
signal are streams of their own; the best one is used (:mod:`mavhums.vehicle.signals`).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Array1, Flags, Flags2, Integers, Integers1, Integers2
from mavhums.core.kernels import kernel, subroutine
from mavhums.vehicle.facts import CONTINUOUS, STEPPED, Signal
from mavhums.vehicle.signals import DERIVED, CandidateStream, Choice, body_rates

RATE_HZ: Final = 20
"""Rate of the grid: more costs memory and time, and streams of 10 Hz carry no more."""
SHOWN_EVERY: Final = 5
"""Rows: what is drawn has four values a second."""
_HELD_S: Final = 5.0  # a state holds as long: heartbeats come once a second, some of them are lost
_COUNTED: Final = ("outputs", "outputs_2", "attitude", "rates", "state")
_CHOSEN: Final = ("attitude", "rates", "force", "demand", "airspeed", "altitude")
"""Signals that several messages carry in some format."""
_HALF_S: Final = 0.5 / RATE_HZ
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


class Stream(NamedTuple):
    """One message that carries a signal, and its place among those of that signal."""

    name: str
    rank: int
    message: str

    @classmethod
    def of(cls, signal: Signal) -> Stream:
        """Return the stream of new samples."""
        return cls(signal.name, signal.rank, signal.source)


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


@dataclass(frozen=True, slots=True, eq=False)
class Seconds:
    """Settled seconds: arrays of k seconds with ``RATE_HZ`` rows each.

    Attributes
    ----------
    index
        Whole flight seconds, shape (k,), increasing; seconds without any sample are omitted.
    signals
        By name, shape (k, RATE_HZ, columns). Names such as ``outputs_spacing`` have one column: the distance
        between the samples before and after a row, s.
    ranks
        By name of a signal that several messages carry, which of them was used, shape (k,); -1 for none.
    """

    index: Integers
    signals: Mapping[str, Array]
    ranks: Mapping[str, Integers] = field(default_factory=dict)

    @property
    def rows(self) -> dict[str, Array]:
        """The signals row by row, shape (k * RATE_HZ, columns)."""
        return {name: values.reshape(-1, values.shape[-1]) for name, values in self.signals.items()}

    def part(self, a: int, b: int) -> Seconds:
        """Return the seconds from place ``a`` to before place ``b``."""
        signals = {name: values[a:b] for name, values in self.signals.items()}
        return Seconds(self.index[a:b], signals, {name: ranks[a:b] for name, ranks in self.ranks.items()})


class _Samples(NamedTuple):
    """Samples of a stream: times, s, (n,), what was settled before each came, and values, (n, columns)."""

    time_s: Array
    settled_s: Array
    values: Array

    def around(self, at: Array, second: Array) -> tuple[Integers, Integers]:
        """Return the indices of the times with samples on both sides, and of the samples after these.

        A sample that came once the ``second`` of a time was settled is unknown there, as it is where the log
        comes in small blocks.
        """
        after: Integers = np.searchsorted(self.time_s, at, side="right").astype(np.int64)
        inside: Integers = np.flatnonzero((after > 0) & (after < self.time_s.size))
        inside = inside[self.settled_s[after[inside]] <= second[inside]]
        return inside, after[inside]

    def between(self, at: Array, second: Array, *, turns: bool = False) -> Array:
        """Interpolate; return NaN where the samples on both sides are more than a gap apart.

        ``turns`` tells that the values are angles, which are interpolated the shorter way round.
        """
        out = np.full((at.size, self.values.shape[1]), np.nan)
        inside, right = self.around(at, second)
        left = right - 1
        span = self.time_s[right] - self.time_s[left]
        share = ((at[inside] - self.time_s[left]) / span)[:, None]
        step = self.values[right] - self.values[left]
        if turns:
            step = (step + np.pi) % (2 * np.pi) - np.pi
        out[inside] = np.where((span <= GAP_S)[:, None], self.values[left] + share * step, np.nan)
        return out

    def spacing(self, at: Array, second: Array) -> Array:
        """Return the distance between the samples around each time, shape (n,); NaN where they are far apart.

        Of a stream that was silent for long, the next sample may or may not be known when a second settles.
        """
        out = np.full(at.size, np.nan)
        inside, right = self.around(at, second)
        out[inside] = self.time_s[right] - self.time_s[right - 1]
        out[out > _HELD_S] = np.nan
        return out

    def last_reported(self, at: Array) -> Array:
        """Return the last reported value; NaN if none was reported for seconds."""
        if not self.time_s.size:
            return np.full((at.size, self.values.shape[1]), np.nan)
        before = np.searchsorted(self.time_s, at, side="right") - 1
        row = np.maximum(before, 0)
        known = (before >= 0) & (at - self.time_s[row] <= _HELD_S)
        return np.where(known[:, None], self.values[row], np.nan)


class Grid:
    """Resamples one vehicle's signals on the grid.

    Parameters
    ----------
    start_us
        Start of flight time, microseconds of UTC.
    """

    def __init__(self, start_us: int) -> None:
        self._start_us = start_us
        self._kept: dict[Stream, _Samples] = {}
        self._choices = {name: Choice(GAP_S) for name in _CHOSEN}
        self._order = Order()
        self._settled = -(1 << 40)

    def feed(self, signals: Sequence[Signal], *, final: bool = False) -> Seconds | None:
        """Take new samples and return the seconds that they settle; ``final`` marks the end of the input."""
        self._take(signals)
        index = self._heard(np.inf if final else self._order.complete_until_s)
        if not index.size:
            return None
        at = (index[:, None] + np.arange(RATE_HZ) / RATE_HZ).ravel()
        second = np.repeat(index, RATE_HZ).astype(np.float64)
        found = {}
        for name, columns in STEPPED.items():
            known = [self._kept[stream] for stream in self._streams(name)]
            held = known[0].last_reported(at) if known else np.full((at.size, columns), np.nan)
            found[name] = held.reshape(index.size, RATE_HZ, columns)
        candidates = {name: self._candidates(name, at, second) for name in CONTINUOUS}
        ranks = {"attitude": self._choices["attitude"].step(index.size, candidates["attitude"])}
        change = self._derived_rates(at, second, ranks["attitude"])
        candidates["rates"].append(change)
        for name in _CHOSEN[1:]:
            truth = change if name == "rates" else None
            ranks[name] = self._choices[name].step(index.size, candidates[name], truth)
        for name, columns in CONTINUOUS.items():
            found[name] = np.full((index.size, RATE_HZ, columns), np.nan)
            found[f"{name}_spacing"] = np.full((index.size, RATE_HZ, 1), np.nan)
            for one in candidates[name]:
                used = ranks[name] == one.rank if name in ranks else slice(None)
                found[name][used] = one.values[used]
                found[f"{name}_spacing"][used, :, 0] = one.spacing[used]
        self._settled = int(index[-1]) + 1
        self._forget()
        return Seconds(index, found, ranks)

    def _streams(self, name: str) -> list[Stream]:
        """Return the streams of a signal that were heard, the preferred one first."""
        return sorted(stream for stream in self._kept if stream.name == name)

    def _candidates(self, name: str, at: Array, second: Array) -> list[CandidateStream]:
        shape = at.size // RATE_HZ, RATE_HZ
        return [
            CandidateStream(
                stream.rank,
                self._kept[stream].between(at, second, turns=name == "attitude").reshape(*shape, -1),
                self._kept[stream].spacing(at, second).reshape(shape),
            )
            for stream in self._streams(name)
        ]

    def _derived_rates(self, at: Array, second: Array, ranks: Integers) -> CandidateStream:
        """Return the body rates by the change of the attitude over each row, where its streams are used."""
        shape = at.size // RATE_HZ, RATE_HZ
        rates, spacing = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        for stream in self._streams("attitude"):
            kept, used = self._kept[stream], ranks == stream.rank
            before, after = (kept.between(at + half, second, turns=True) for half in (-_HALF_S, _HALF_S))
            rates[used] = body_rates(before, after, 2 * _HALF_S).reshape(*shape, 3)[used]
            spacing[used] = kept.spacing(at, second).reshape(shape)[used]
        return CandidateStream(DERIVED, rates, spacing)

    def source(self, name: str, rank: int) -> str:
        """Return the message of a signal's stream, as a verdict names it."""
        if rank == DERIVED:
            return "the change of the attitude"
        return next(stream.message for stream in self._kept if stream[:2] == (name, rank))

    @property
    def held(self) -> int:
        """Number of samples that are kept for the seconds to come."""
        return sum(kept.time_s.size for kept in self._kept.values())

    def reached_s(self, frames: Integers, signals: Sequence[Signal]) -> Integers:
        """Return the second of the latest sample before places in the log, (n,), given the next signals.

        It is 0 before the first sample, and never before a second that is settled.
        """
        frame = np.concatenate([np.empty(0, dtype=np.int64), *(signal.frame for signal in signals)])
        time_s = np.concatenate([np.empty(0), *((s.time_us - self._start_us) / 1e6 for s in signals)])
        order = np.argsort(frame, kind="stable")
        latest = np.maximum.accumulate(np.append(max(self._order.newest_s, 0.0), time_s[order]))
        reached: Integers = np.floor(latest[np.searchsorted(frame[order], frames)]).astype(np.int64)
        return reached

    def received(self) -> dict[str, Received]:
        """Return, by message, how many samples were kept, came late, or came twice."""
        found: dict[str, Received] = {}
        for stream in sorted(self._kept):  # the order of their arrival depends on how the log was cut
            counts = self._order.received(stream)
            found[stream.message] = max(found.get(stream.message, counts), counts, key=sum)
        return found

    def _take(self, signals: Sequence[Signal]) -> None:
        arrivals = [
            Arrivals(
                Stream.of(signal),
                signal.frame,
                (signal.time_us - self._start_us) / 1e6,
                signal.stamped,
                signal.name in CONTINUOUS,
            )
            for signal in signals
        ]
        for signal, new, settled_s in zip(signals, arrivals, self._order.feed(arrivals), strict=True):
            good = ~np.isnan(settled_s)
            came = _Samples(new.time_s[good], settled_s[good], signal.values[good])
            old = self._kept.get(Stream.of(signal), _Samples(*(part[:0] for part in came)))
            self._kept[Stream.of(signal)] = _Samples(*map(np.concatenate, zip(old, came, strict=True)))

    def _heard(self, reach: float) -> Integers:
        """Return the settled seconds that contain or adjoin a sample of the attitude or of an output."""
        heard = [np.floor(kept.time_s) for stream, kept in self._kept.items() if stream.name in _COUNTED]
        seconds = np.unique(np.concatenate([np.empty(0), *heard])).astype(np.int64)
        return seconds[(seconds >= self._settled) & (seconds + 1 <= reach)]

    def _forget(self) -> None:
        """Keep the samples that the next second may need: the one before it, and all later ones."""
        for stream, kept in self._kept.items():
            first = max(int(np.searchsorted(kept.time_s, self._settled - GAP_S)) - 1, 0)
            self._kept[stream] = _Samples(*(part[first:] for part in kept))


def lengths(rows: Flags, before: int) -> Integers:
    """Return for how many rows it has lasted at each row, (n,), given for how many before the first one.

    Examples
    --------
    >>> lengths(np.array([True, False, True, True]), 5).tolist()
    [6, 0, 1, 2]
    """
    places = np.arange(len(rows))
    last = np.maximum.accumulate(np.where(rows, -1, places))
    lasted: Integers = np.where(last < 0, before + places + 1, places - last)
    return lasted
