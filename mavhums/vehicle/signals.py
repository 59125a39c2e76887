"""The signals of every vehicle, from the tables of any format, and which of several streams to believe.

If several messages of a vehicle give a continuous signal, each is a stream of its own; of other signals the
first message received is used. If several components send a signal, the first sender is used.

A ground station may ask for the gyro at 2 Hz and for the attitude, which has the same rates, at 10 Hz. So
every stream of a signal is kept, and the one with the shortest spacing is used, second by second. It changes
only for one that is clearly better over ten seconds, because what is measured with another stream is not
comparable. A stream of body rates must also agree with the change of the attitude.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.log import Table
from mavhums.vehicle.facts import SIGNALS, STEPPED, Signal
from mavhums.vehicle.formats import by_vehicle, messages_of, reports
from mavhums.vehicle.formats.base import FactReport, Source, wide
from mavhums.vehicle.formats.mavlink import CLOCKS
from mavhums.vehicle.states import kind_named, texts

SIGNAL_MESSAGES: Final = CLOCKS | messages_of(*SIGNALS, "armed", "arming", "mode", "text", "parameter")
"""Messages of any format that carry signals, or what they depend on."""

DERIVED: Final = 99
"""Rank of what is derived from another signal."""

_MEMORY_S: Final = 10  # shorter follows the loss of a few messages, longer loses more after a true change
_LESSER: Final = 1.5  # cost of streams after the preferred one: estimates are smoother, and later
_DERIVED: Final = _LESSER**2  # cost of the change of the attitude: an estimate, smoothed by the difference
_BETTER: Final = 0.8  # of the cost: less than this changes the stream; nearer to 1 flickers

_AGREEMENT_S: Final = 30.0  # memory of the comparison of rates, s: some turns
_MOVING_RAD_S: Final = 0.03  # root mean square below which noise, not motion, would be compared
_SLOPE: Final = (0.5, 2.0)  # of rates on the change of the attitude: wrong units and axes lie far outside
_DISAGREES: Final = 10.0  # times the cost: used only where nothing else is heard


class SignalReader:
    """Reads signals from tables, block by block."""

    def __init__(self) -> None:
        self._chosen: dict[tuple[int, str], tuple[Source, int]] = {}
        self._kinds: dict[int, tuple[int, float]] = {}
        self._modes: dict[int, float] = {}
        self._arming: dict[int, tuple[float, float]] = {}
        self._began: set[int] = set()
        self._follows: dict[int, int] = {}  # frame of the first record that follows whether it is armed

    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the signals of these tables."""
        yield from self._joined_states(tables)
        parts = [*by_vehicle(tables, *SIGNALS)]
        self._choose(parts)
        for vehicle, report in parts:
            first, component = self._chosen[vehicle, report.source.fact]
            source = report.source
            if source is not first and source.fact in STEPPED:
                continue
            own = report if source.all_components else report.select(report.table.component == component)
            if len(own.table):
                times, stamped = (own.table.frame, own.table.time_us), own.format.is_stamped(own.table)
                yield Signal(vehicle, source.fact, source.message, *times, own.values, stamped, own.rank)

    def _choose(self, parts: list[tuple[int, FactReport]]) -> None:
        """Choose for each signal the message and its sender that came first, whatever block they came in."""
        firsts: dict[tuple[int, str], int] = {}
        for vehicle, report in parts:
            key, first = (vehicle, report.source.fact), int(report.table.frame[0])
            if first < firsts.get(key, 1 << 62) and (key in firsts or key not in self._chosen):
                firsts[key] = first
                self._chosen[key] = report.source, int(report.table.component[0])

    def _joined_states(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the states of a format that records kind, arming and mode apart, whenever arming comes."""
        for said in texts(tables):
            kind = kind_named(said.text)
            if kind is not None:
                self._kinds.setdefault(said.vehicle, (said.frame, float(kind)))
        modes = [*reports(tables, "mode")]
        armed = [*by_vehicle(tables, "armed")]
        for vehicle, part in armed:
            self._follows.setdefault(vehicle, int(part.table.frame[0]))
        yield from self._between_armings(tables, modes)
        for vehicle, part in armed:
            yield self._state(vehicle, part, part.values, modes)
        for report in modes:
            for vehicle, number in zip(report.table.system.tolist(), report.values[:, 3], strict=True):
                self._modes[vehicle] = float(number)

    def _between_armings(self, tables: Mapping[str, Table], modes: list[FactReport]) -> Iterator[Signal]:
        """Yield the states of vehicles that record only when they arm, whenever outputs come."""
        changes = [*reports(tables, "arming")]
        for vehicle, part in by_vehicle(tables, "outputs") if changes or self._arming else ():
            own = [one.select(one.table.system == vehicle) for one in changes]
            frames = np.concatenate([[-1], *(one.table.frame for one in own)])
            before = self._arming.get(vehicle, (np.nan, np.nan))
            order = np.argsort(frames, kind="stable")
            values = np.concatenate([[before], *(one.values for one in own)])[order]
            held = values[np.searchsorted(frames[order], part.table.frame) - 1]
            known = (part.table.frame < self._follows.get(vehicle, 1 << 62)) & np.isfinite(held[:, 0])
            if known.any():
                # A first change that disarms says that the log began armed, and not since when.
                if vehicle not in self._began and held[known.argmax(), 1] == 0:
                    held[known.argmax(), 1] = np.nan
                self._began.add(vehicle)
                yield self._state(vehicle, part.select(known), held[known], modes)
        for report in sorted(changes, key=lambda one: int(one.table.frame[-1])):
            last = zip(report.table.system.tolist(), report.values.tolist(), strict=True)
            self._arming |= {vehicle: tuple(value) for vehicle, value in last}

    def _state(self, vehicle: int, armed: FactReport, values: Array, modes: list[FactReport]) -> Signal:
        frame = armed.table.frame
        since, kind = self._kinds.get(vehicle, (0, np.nan))
        frames, numbers = [np.array([-1])], [np.array([self._modes.get(vehicle, np.nan)])]
        for report in modes:
            own = report.select(report.table.system == vehicle)
            frames.append(own.table.frame)
            numbers.append(own.values[:, 3].astype(np.float64))
        mode = np.concatenate(numbers)[np.searchsorted(np.concatenate(frames), frame) - 1]
        kinds = np.where(frame > since, kind, np.nan)
        states = np.column_stack([kinds, values, mode])
        return Signal(vehicle, "state", armed.source.message, frame, armed.table.time_us, states)


def all_outputs(signals: Mapping[str, Array]) -> Array:
    """Return the pulses of all outputs, (n, ALL_OUTPUTS), from the signals on a common grid."""
    pulses = wide(signals["outputs"], 0)
    for name in ("outputs_2", "outputs_3"):
        np.copyto(pulses, signals[name], where=np.isfinite(signals[name]))
    return pulses


class CandidateStream(NamedTuple):
    """One stream of a signal over whole seconds.

    Attributes
    ----------
    rank
        Its place in the format's table: the first one heard is preferred.
    values
        On the grid, shape (k, rows, columns).
    spacing
        Distance of the samples around each row, s, shape (k, rows); NaN where it is silent.
    """

    rank: int
    values: Array
    spacing: Array


class Choice:
    """Chooses the stream of one signal, second by second and causally.

    Parameters
    ----------
    silent_s
        Spacing that a silent stream counts as, s.
    """

    def __init__(self, silent_s: float) -> None:
        self._silent_s = silent_s
        self._recent: dict[int, deque[float]] = {}
        self._agreed: dict[int, tuple[float, float]] = {}
        self._chosen = -1

    def step(
        self, seconds: int, candidates: Sequence[CandidateStream], truth: CandidateStream | None = None
    ) -> Integers:
        """Return the rank of the stream of each second, shape (k,); -1 before any is heard.

        Parameters
        ----------
        seconds
            Their number k.
        candidates
            Those heard so far; one that is still silent changes nothing.
        truth
            The candidate that the others must agree with; None if there is none.
        """
        spacings = {one.rank: self._spacing(one) for one in candidates}
        others = [one for one in candidates if one is not truth]
        products = {one.rank: _products(one.values, truth.values) for one in others} if truth else {}
        chosen = np.empty(seconds, dtype=np.int64)
        for k in range(seconds):
            for rank, sums in products.items():
                self._compare(rank, *sums[k])
            self._choose({rank: float(spacing[k]) for rank, spacing in spacings.items()})
            chosen[k] = self._chosen
        return chosen

    def _spacing(self, one: CandidateStream) -> Array:
        """Return the mean spacing of each second, (k,): over time, so that one long gap counts as such."""
        # A sample without a number is none.
        known = np.isfinite(one.values).any(axis=2) & (one.spacing < self._silent_s)
        mean: Array = np.where(known, one.spacing, self._silent_s).mean(axis=1)
        # Rounded, the mean of a silent second lies just below: it would not count as silent.
        mean[~known.any(axis=1)] = self._silent_s
        return mean

    def _compare(self, rank: int, product: float, square: float, rows: float) -> None:
        kept = np.exp(-1.0 / _AGREEMENT_S)
        before, power = self._agreed.get(rank, (0.0, 0.0))
        if rows > 0:
            self._agreed[rank] = kept * before + product / rows, kept * power + square / rows

    def _choose(self, spacing: dict[int, float]) -> None:
        # An outage of the whole link says nothing about one of its streams.
        if min(spacing.values(), default=self._silent_s) >= self._silent_s:
            return
        for rank, value in spacing.items():
            if rank in self._recent or value < self._silent_s:
                self._recent.setdefault(rank, deque(maxlen=_MEMORY_S)).append(value)
        means = {rank: sum(recent) / len(recent) for rank, recent in sorted(self._recent.items())}
        weights = {
            next(rank for rank, mean in means.items() if mean < self._silent_s): 1.0,
            DERIVED: _DERIVED,
        }
        agree = {
            rank: _SLOPE[0] < product / power < _SLOPE[1]
            for rank, (product, power) in self._agreed.items()
            if power > _AGREEMENT_S * _MOVING_RAD_S**2  # else there is too little motion to compare
        }
        # Where no stream agrees, the attitude is wrong, as before the estimator has settled.
        wrong = {rank for rank, right in agree.items() if not right} if any(agree.values()) else set()
        costs = {
            rank: mean * weights.get(rank, _LESSER) * (_DISAGREES if rank in wrong else 1.0)
            for rank, mean in means.items()
        }
        best = min(costs, key=costs.__getitem__)
        if self._chosen < 0 or costs[best] < _BETTER * costs[self._chosen]:
            self._chosen = best


def _products(values: Array, truth: Array) -> Array:
    """Return the sums of products and of squares of the truth of each second, and their rows, (k, 3)."""
    known = np.isfinite(values + truth).all(axis=2, keepdims=True)
    own, other = np.where(known, values, 0.0), np.where(known, truth, 0.0)
    sums: Array = np.column_stack([(own * other).sum((1, 2)), (other**2).sum((1, 2)), known.sum((1, 2))])
    return sums


def body_rates(before: Array, after: Array, step_s: float) -> Array:
    """Return the mean body rates between two attitudes (roll, pitch, yaw), rad/s, shape (n, 3).

    Examples
    --------
    >>> body_rates(np.zeros((1, 3)), np.array([[0.01, 0.0, 0.0]]), 0.05).round(6).tolist()
    [[0.2, 0.0, 0.0]]
    """
    change = (after - before + np.pi) % (2 * np.pi) - np.pi
    roll_rate, pitch_rate, yaw_rate = (change / step_s).T
    roll, pitch = ((before + (change / 2)).T)[:2]
    return np.stack(
        [
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll),
            yaw_rate * np.cos(pitch) * np.cos(roll) - pitch_rate * np.sin(roll),
        ],
        axis=1,
    )
