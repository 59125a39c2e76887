"""What a whole log records of use, counted in constant memory: outputs, named values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Flags, Flags1, Integers, Integers1, Integers2
from mavhums.core.kernels import kernel
from mavhums.log import Table
from mavhums.log.base.decoder import text_of
from mavhums.vehicle.facts import OUTPUTS, Signal
from mavhums.vehicle.formats import by_vehicle, messages_of

BAND_US: Final = 8
"""Movement that counts: 1 % of the usual travel of 800 µs, above the dead band of a usual servo."""

HELD_S: Final = 2.0
"""Longest time for which a sample of an output, or a state, is taken to hold: one of those that come once a
second may be lost; longer would count gaps of the link as use."""

_OFF: Final = -1
_LEAST_US, _GREATEST_US = 800, 2200  # each µs is counted, in bounded memory; pulses beyond count as the ends
_STOP: Final = 0.01  # share of the calibrated range: so near to an end an output is at its stop
_HELD_US: Final = round(HELD_S * 1e6)


class OutputUse(NamedTuple):
    """The use of one output.

    Attributes
    ----------
    least_us, greatest_us
        Shortest and longest pulse.
    travelled_us
        Sum of all movements.
    reversals
        Changes of direction.
    held_us
        Microseconds for which each pulse from 800 to 2200 µs was held while armed, shape (1401,).
    """

    least_us: int
    greatest_us: int
    travelled_us: int
    reversals: int
    held_us: Integers

    @property
    def commanded(self) -> bool:
        """Whether the output moved at all."""
        return self.greatest_us - self.least_us >= BAND_US

    @property
    def held_s(self) -> float:
        """Time for which the output was followed while armed."""
        return float(self.held_us.sum()) / 1e6

    @property
    def mean_us(self) -> float | None:
        """Mean pulse over that time; None if that time is zero."""
        total = int(self.held_us.sum())
        return float(self.held_us @ np.arange(_LEAST_US, _GREATEST_US + 1)) / total if total else None

    def at_stops_s(self, low_us: int, high_us: int) -> tuple[float, float]:
        """Return the time for which it was within 1 % of the calibrated range of either end, or beyond."""
        near = max(round((high_us - low_us) * _STOP), 1)
        low = self.held_us[: max(low_us + near - _LEAST_US + 1, 0)].sum()
        high = self.held_us[max(high_us - near - _LEAST_US, 0) :].sum()
        return float(low) / 1e6, float(high) / 1e6


class Usage:
    """Follows the servo outputs and the armed state of one vehicle, block by block.

    Examples
    --------
    >>> Usage().armed_s is None, Usage().outputs
    (True, {})
    """

    def __init__(self) -> None:
        self._held = np.zeros((OUTPUTS, 0), dtype=np.int64)  # made with the first output: it is 170 kB
        self._least = np.full(OUTPUTS, np.iinfo(np.int64).max)
        self._greatest = np.full(OUTPUTS, _OFF)
        self._travelled, self._reversals = np.zeros((2, OUTPUTS), dtype=np.int64)
        self._turn, self._last = np.full((2, OUTPUTS), _OFF, dtype=np.int64)
        self._direction = np.zeros(OUTPUTS, dtype=np.int64)
        self._time = np.zeros(1, dtype=np.int64)
        self._armed = np.nan
        self._armed_at_us: int | None = None
        self._armed_us, self._complete = 0, False

    @property
    def armed_s(self) -> float | None:
        """Armed time; None if the log does not contain it, or not from its beginning."""
        return self._armed_us / 1e6 if self._complete else None

    @property
    def outputs(self) -> dict[int, OutputUse]:
        """The use of each output that ever had a pulse, by output number from 1."""
        return {
            k + 1: OutputUse(
                int(self._least[k]),
                int(self._greatest[k]),
                int(self._travelled[k]),
                int(self._reversals[k]),
                self._held[k],
            )
            for k in np.flatnonzero(self._greatest != _OFF).tolist()
        }

    def feed(self, signals: Sequence[Signal]) -> None:
        """Take the vehicle's signals of one block."""
        states = [signal for signal in signals if signal.name == "state"]
        frames = np.concatenate([[-1], *(signal.frame for signal in states)])
        armed = np.concatenate([[self._armed], *(signal.values[:, 2] for signal in states)])
        for signal in states:
            self._state(signal)
        for signal in signals:
            if signal.name == "outputs":
                disarmed = armed[np.searchsorted(frames, signal.frame) - 1] == 0
                self._follow(signal, ~disarmed)

    def _state(self, signal: Signal) -> None:
        if not len(signal.time_us):
            return
        if self._armed_at_us is None:
            self._complete = bool(np.isfinite(signal.values[0, 2]))
        start = signal.time_us[0] if self._armed_at_us is None else self._armed_at_us
        times = np.concatenate([[start], signal.time_us])
        armed = np.concatenate([[self._armed], signal.values[:-1, 2]]) > 0
        self._armed_us += int(np.clip(np.diff(times), 0, _HELD_US)[armed].sum())
        self._armed_at_us, self._armed = int(times[-1]), float(signal.values[-1, 2])

    def _follow(self, signal: Signal, counts: Flags) -> None:
        if not len(signal.values):
            return
        if not self._held.size:
            self._held = np.zeros((OUTPUTS, _GREATEST_US - _LEAST_US + 1), dtype=np.int64)
        known = np.isfinite(signal.values)
        pulses = np.where(known, np.clip(np.rint(signal.values), _LEAST_US, _GREATEST_US), _OFF)
        pulses = pulses.astype(np.int64)
        self._least = np.minimum(self._least, np.where(known, pulses, self._least).min(axis=0))
        self._greatest = np.maximum(self._greatest, pulses.max(axis=0))
        _followed(
            pulses,
            signal.time_us.astype(np.int64),
            counts,
            self._held,
            self._travelled,
            self._reversals,
            self._turn,
            self._direction,
            self._last,
            self._time,
        )


@kernel
def _followed(
    pulses: Integers2,
    time_us: Integers1,
    counts: Flags1,
    held: Integers2,
    travelled: Integers1,
    reversals: Integers1,
    turn: Integers1,
    direction: Integers1,
    last: Integers1,
    last_time: Integers1,
) -> None:
    """Add samples to the sums: pulses of shape (n, outputs), -1 where an output is off."""
    for k in range(pulses.shape[0]):
        passed = min(time_us[k] - last_time[0], _HELD_US)
        last_time[0] = time_us[k]
        for j in range(pulses.shape[1]):
            pulse, before = pulses[k, j], last[j]
            last[j] = pulse
            # A pulse holds until the next sample, but not over a gap: what was sent in it is unknown.
            if before != _OFF and counts[k] and passed > 0:
                held[j, before - _LEAST_US] += passed
            if pulse == _OFF:
                continue
            if before != _OFF:
                travelled[j] += abs(pulse - before)
            if turn[j] == _OFF:
                turn[j] = pulse
            elif direction[j] == 0:
                if abs(pulse - turn[j]) >= BAND_US:
                    direction[j] = 1 if pulse > turn[j] else -1
                    turn[j] = pulse
            elif (pulse - turn[j]) * direction[j] > 0:
                turn[j] = pulse
            elif (turn[j] - pulse) * direction[j] >= BAND_US:
                reversals[j] += 1
                direction[j] = -direction[j]
                turn[j] = pulse


NAMED_MESSAGES: Final = messages_of("named value")

_MOST_NAMES: Final = 1000  # of a log: a sender that makes up names cannot fill the memory


class NamedValues:
    """Counts named values, which scripts and autopilots send under their own names.

    Attributes
    ----------
    counts
        Counts by (system, message, name); only the first thousand names of a log are counted.
    """

    def __init__(self) -> None:
        self.counts: Counter[tuple[int, str, str]] = Counter()

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the named values in these messages."""
        for vehicle, report in by_vehicle(tables, "named value"):
            names, counts = np.unique(report.values, return_counts=True)
            for name, count in zip(names.tolist(), counts.tolist(), strict=True):
                key = (vehicle, report.source.message, text_of(name))
                if key in self.counts or len(self.counts) < _MOST_NAMES:
                    self.counts[key] += count
