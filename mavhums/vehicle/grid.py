"""Resamples the signals of one vehicle on an even time grid, in whole seconds, whatever the block size.

A second is given once it is settled (:mod:`mavhums.vehicle.arrivals`). Between samples a signal is
interpolated; over a gap of more than :data:`~mavhums.vehicle.arrivals.GAP_S` it is NaN. Several messages that
carry one signal are streams of their own; the best one is used (:mod:`mavhums.vehicle.signals`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.vehicle.arrivals import GAP_S, Arrivals, Order, Received
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


class Stream(NamedTuple):
    """One message that carries a signal, and its place among those of that signal."""

    name: str
    rank: int
    message: str

    @classmethod
    def of(cls, signal: Signal) -> Stream:
        """Return the stream of new samples."""
        return cls(signal.name, signal.rank, signal.source)


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

        ``turns`` says that the values are angles, which are interpolated the shorter way round.
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
