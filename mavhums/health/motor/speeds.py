"""What the speed of a motor's ESC says about a loss of thrust: a slow motor, or a propeller without effect.

By motor, speed over the square root of the thrust asked is nearly constant. A motor whose speed falls behind
has a fault before its propeller: in the ESC, the motor or its supply. One whose speed follows has lost its
thrust at the propeller, or the air took it. A speed is never an alarm by itself: some ESCs send zero where
they have nothing to send.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import NORMAL_95
from mavhums.vehicle.grid import RATE_HZ

_BIN_S: Final = 0.5  # a quad without a motor is in the air for a second or two
_BIN_ROWS: Final = round(_BIN_S * RATE_HZ)
_KEPT_BINS: Final = 120
"""Bins that may hold a fault already when it is decided: a window of 25 s, and the lateness of a stream."""
_AFTER_BINS: Final = 16  # after the decision, in which the cause shows
_SETTLES_S: Final = 0.4  # after the onset: a motor runs down
_LEAST_BEFORE: Final = 20  # bins
_LAGS, _FOLLOWS = 0.95, 0.90
"""Speed by that of before, of which the upper end must lie below to lag, and the lower end above to follow: a
loss of 30 % of the thrust leaves 0.84 of the speed, and healthy motors agree within 0.03."""
_LEAST_SCATTER: Final = 0.02  # of a bin: of healthy motors at 3 to 10 Hz 0.01 to 0.04
_MOST_ESCS: Final = 16
_AGREES: Final = 0.5
"""Correlation of a motor's own part of the outputs with a speed from which the ESC is this motor's."""
_COLLAPSED: Final = 0.3
_FULL: Final = 0.9  # share of full thrust


class SpeedCause(NamedTuple):
    """What a motor's speed says about its loss: its ratio to the speed before, when, and the cause."""

    ratio: float
    start_s: float
    end_s: float
    words: str


class EscSpeeds:
    """The speeds that ESCs report, in bins of half a second, in constant memory."""

    def __init__(self) -> None:
        self._bins: dict[int, dict[int, list[float]]] = {}  # by ESC and bin: sum, samples, changes
        self._last: dict[int, float] = {}

    def hear(self, esc: int, time_s: Array, speeds: Array) -> None:
        """Take the speeds of one ESC, from 0, in order."""
        bins = self._bins.setdefault(esc, {})
        last = self._last.get(esc, np.nan)
        known = np.isfinite(speeds)
        at, values = (time_s[known] // _BIN_S).astype(np.int64), np.abs(speeds[known])
        if not at.size:
            return
        changed = np.diff(values, prepend=last) != 0.0
        self._last[esc] = float(values[-1])
        for one in np.unique(at).tolist():
            own = bins.setdefault(one, [0.0, 0.0, 0.0])
            here = at == one
            own[0] += float(values[here].sum())
            own[1] += float(here.sum())
            own[2] += float(changed[here].sum())

    @property
    def count(self) -> int:
        """The number of ESCs that reported a speed."""
        return len(self._bins)

    def forget(self, first: int, last: float) -> None:
        """Forget all bins before ``first`` and after ``last``."""
        for bins in self._bins.values():
            for one in [one for one in bins if not first <= one <= last]:
                del bins[one]

    def at(self, one: int, escs: Sequence[int]) -> Array:
        """Return the mean speed of each ESC in a bin, shape (n,); NaN where it only repeats itself."""
        found = np.full(len(escs), np.nan)
        for k, esc in enumerate(escs):
            total, samples, changes = self._bins.get(esc, {}).get(one, (0.0, 0.0, 0.0))
            # A motor that runs never turns twice alike; one at rest does.
            if samples and (changes or total == 0.0):
                found[k] = total / samples
        return found

    def escs_of(self, servos: Sequence[int]) -> list[int]:
        """Return the ESC of each motor: numbered as its output, else as the motor."""
        by_output = [servo - 1 for servo in servos]
        return by_output if set(by_output) <= self._bins.keys() else [*range(len(servos))]


class SpeedsBesideThrust:
    """Compares the motors' speeds with the thrust that is asked of them.

    Parameters
    ----------
    heard
        The speeds.
    servos
        Output of each motor.
    """

    def __init__(self, heard: EscSpeeds, servos: Sequence[int]) -> None:
        self._heard, self._servos = heard, tuple(servos)
        self._asked: dict[int, Array] = {}
        # Of each motor beside each ESC: bins, mean, sum of squares of the ratio, and sums of the correlation.
        self._sums = np.zeros((3, len(servos), _MOST_ESCS))
        self._pairs = np.zeros((6, len(servos), _MOST_ESCS))

    def add(self, first_s: int, thrusts: Array, flown: Flags, decided_s: float | None) -> None:
        """Take whole seconds: thrusts asked, (n, motors), where it flew, when a loss was decided."""
        for k in range(len(thrusts) // _BIN_ROWS):
            rows = slice(k * _BIN_ROWS, (k + 1) * _BIN_ROWS)
            if flown[rows].all():
                self._asked[round(first_s / _BIN_S) + k] = thrusts[rows].mean(axis=0)
        last = np.inf if decided_s is None else decided_s // _BIN_S + _AFTER_BINS
        now = (first_s + len(thrusts) / RATE_HZ) // _BIN_S if decided_s is None else decided_s // _BIN_S
        first = int(now) - _KEPT_BINS
        for one in [one for one in sorted(self._asked) if one < first]:
            self._sums = self._with(self._sums, self._ratios(one))
            self._pairs = self._pairs + self._paired(one)
            del self._asked[one]
        for one in [one for one in self._asked if one > last]:
            del self._asked[one]
        self._heard.forget(first, last)

    def cause(self, motor: int, since_s: float) -> SpeedCause | None:
        """Return what the speed of a motor, from 0, says about its loss; None where it says nothing."""
        sums, pairs = self._sums, self._pairs
        after = [one for one in sorted(self._asked) if one * _BIN_S >= since_s + _SETTLES_S]
        for one in sorted(self._asked):
            if (one + 1) * _BIN_S <= since_s:
                sums = self._with(sums, self._ratios(one))
                pairs = pairs + self._paired(one)
        escs, how = self._matched(pairs)
        count, mean, squares = sums[:, range(len(escs)), escs]
        usual = np.where(count >= _LEAST_BEFORE, mean, np.nan)
        found = [self._ratios(one)[range(len(escs)), escs] for one in after]
        ratios = np.array([row / usual for row in found]).reshape(-1, len(usual))
        others = [row[np.isfinite(row)] for row in np.delete(ratios, motor, axis=1)]
        # A battery that sags slows all of them.
        rest = np.array([np.median(row) if row.size else 1.0 for row in others])
        own = ratios[:, motor] / rest
        good = np.flatnonzero(np.isfinite(own) & (rest > _COLLAPSED))
        if not good.size or not how:
            return None
        ratio = float(own[good].mean())
        scatter = max(float(np.sqrt(squares[motor] / (count[motor] - 1)) / mean[motor]), _LEAST_SCATTER)
        half = NORMAL_95 * scatter / good.size**0.5
        bins = [after[k] for k in good.tolist()]
        asked = float(np.mean([self._asked[one][motor] for one in bins]))
        words = _words(ratio, half, asked)
        words = f"{words} (ESC {escs[motor]}, {how})" if words else ""
        return SpeedCause(ratio, bins[0] * _BIN_S, (bins[-1] + 1) * _BIN_S, words) if words else None

    def _matched(self, sums: Array) -> tuple[list[int], str]:
        """Return the ESC of each motor, and how it is known: by the flight, else by its number."""
        numbered = self._heard.escs_of(self._servos)
        count, x, y, xx, yy, xy = sums
        with np.errstate(divide="ignore", invalid="ignore"):
            agree = (count * xy - x * y) / np.sqrt((count * xx - x * x) * (count * yy - y * y))
        agree = np.where(np.isfinite(agree) & (count >= _LEAST_BEFORE), agree, 0.0)
        # ESCs are counted from 0 or from 1, as outputs or as motors, and some drive no motor of these: which
        # one drives a motor shows where its speed follows this motor's output, and no other's.
        if (agree.max(axis=1) > _AGREES).all():
            escs = _distinct(agree)
            if (agree[np.arange(len(escs)), escs] > _AGREES).all():
                return escs.tolist(), "whose speed follows the output of this motor"
        # Where the flight does not show it, as many ESCs as motors are taken to count alike.
        return numbered, "by its number" if self._heard.count == len(numbered) else ""

    def _ratios(self, one: int) -> Array:
        """Return speed by the root of thrust in a bin, of each motor beside each ESC, NaN where unknown."""
        asked = self._asked[one][:, None]
        speeds = self._heard.at(one, range(_MOST_ESCS))
        ratios: Array = np.where(asked > 0.02, speeds / np.sqrt(np.maximum(asked, 0.02)), np.nan)
        return ratios

    def _paired(self, one: int) -> Array:
        """Return a bin's part of the sums that correlate each motor's output with each ESC's speed."""
        root = np.sqrt(np.maximum(self._asked[one], 0.0))  # an output may lie below that of no thrust
        speeds = self._heard.at(one, range(_MOST_ESCS))
        turns = np.isfinite(speeds) & (speeds > 0.0)
        if not turns.any():
            return np.zeros_like(self._pairs)
        # What all motors do alike, as in a climb, distinguishes none.
        y = np.where(turns, speeds / np.median(speeds[turns]) - 1.0, 0.0)
        x = (root / max(float(np.median(root)), 0.1) - 1.0)[:, None] * turns
        known = np.broadcast_to(turns, x.shape)
        return np.stack(np.broadcast_arrays(known, x, y, x * x, y * y, x * y))

    @staticmethod
    def _with(sums: Array, ratios: Array) -> Array:
        known = np.isfinite(ratios) & (ratios > 0.0)
        count = sums[0] + known
        off = np.where(known, ratios - sums[1], 0.0)
        mean = sums[1] + off / np.maximum(count, 1.0)
        return np.stack([count, mean, sums[2] + off * np.where(known, ratios - mean, 0.0)])


def _words(ratio: float, half: float, asked: float) -> str:
    if ratio + half < _COLLAPSED:
        at = " at full output: desynchronisation, a lost phase," if asked >= _FULL else ":"
        return f"its speed collapsed{at} the ESC, the motor or its supply"
    share = f"{100 * ratio:.0f} % of what its output gave before"
    if ratio + half < _LAGS:
        return f"its speed lags its output ({share}): the ESC, the motor or its supply"
    if ratio - half > _FOLLOWS:
        return f"its speed follows its output ({share}): the propeller, or moving air"
    return ""


def _distinct(agree: Array) -> NDArray[np.intp]:
    """Return a column for each row, none twice, by the largest sum."""
    best: NDArray[np.intp] = agree.argmax(axis=1)
    if len(set(best.tolist())) == len(best):
        return best
    from scipy.optimize import linear_sum_assignment  # 0.1 s to import

    return np.asarray(linear_sum_assignment(-agree)[1])
