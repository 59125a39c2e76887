"""Which of a servo's quantities are no evidence: what the log only repeats, and a current without its sign.

A register that a servo refreshes once a second is sent with every message. While the shaft moves, a quantity
that is sampled changes; one that only repeats itself is no evidence, whatever the rate of the messages.

A motor that stands takes a current of the sign of its voltage. A current that is positive at either sign is a
magnitude, and no equation that needs signs holds for it.

The counts run from sample to sample, so that the division of the log into blocks does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Array1, Array2, Flags, Flags2, Integers
from mavhums.core.kernels import kernel
from mavhums.core.quantities import KEYS, column

NOT_USED: Final = " (not used: {})"
"""What the provenance of a quantity that is no evidence ends with."""

_JUDGED: Final = tuple(column(key) for key in ("V4", "V5", "V7", "V8", "V10"))
_NAMES: Final = {"V4": "voltage", "V5": "current", "V7": "speed", "V8": "torque", "V10": "shaft's speed"}
_SPEEDS: Final = tuple(column(key) for key in ("V7", "V10"))
_V3, _V4, _V5, _V7, _V8, _V10 = (column(f"V{k}") for k in (3, 4, 5, 7, 8, 10))
_LONGEST_STEP_S: Final = 0.5
"""A longer step between samples is a pause of the telemetry, in which nothing could change."""

_DECIDED_S: Final = 2.0
"""Motion after which a quantity may count as repeated, s: less would call two equal readings a register that
stands still, more would let a register's first readings count. By hand; a healthy current changes within
0.1 s."""

_CHANGED_SHARE: Final = 0.25
"""Share of samples that change from which a quantity is sampled however slow the log is. A register refreshed
once a second changes in 1 % of the samples at 100 Hz and in 20 % at 5 Hz."""

_UNSIGNED_SAMPLES: Final = 5
"""Samples at standstill whose voltage is negative and whose current is not, from which on a current that was
never negative is a magnitude: one may be noise of the voltage. By hand."""

_STANDING_SHARE: Final = 0.02
"""Share of the highest speed so far below which the shaft stands: so small is its back-EMF."""

_LOADED_SHARE: Final = 0.1
"""Share of the highest voltage so far above which a standing motor is loaded: less is noise."""

_UNSIGNED = "the current has no sign"


class Freshness:
    """Counts how often each quantity of one actuator changes while the shaft moves, and its current's signs.

    Parameters
    ----------
    min_rate_hz
        Changes a second below which a quantity is not sampled.
    """

    def __init__(self, min_rate_hz: float) -> None:
        self._min_rate_hz = min_rate_hz
        self._last = np.full(len(KEYS) + 1, np.nan)
        self._counts = np.zeros((3, len(KEYS)))  # time in motion s, samples in motion, changes
        self._signs = np.zeros(4)  # highest voltage and speed, contradictions, negative currents

    def feed(self, utc_us: Integers, values: Array) -> Flags:
        """Return which values are no evidence; times (n,) and measured V1…V12 (n, 12), NaN else."""
        refused = np.zeros(values.shape, dtype=np.bool_)
        _count(
            np.asarray(utc_us * 1e-6, dtype=np.float64),
            values,
            self._last,
            self._counts,
            self._min_rate_hz,
            refused,
        )
        _unsigned(values, self._signs, refused)
        return refused

    def reasons(self) -> dict[str, str]:
        """Return why a quantity is no evidence, by key.

        Examples
        --------
        >>> Freshness(5.0).reasons()
        {}
        """
        found = {
            KEYS[k]: f"the {_NAMES[KEYS[k]]} is {refreshed(float(self._counts[2, k] / self._counts[0, k]))}"
            for k in _JUDGED
            if _repeats(self._counts[0, k], self._counts[1, k], self._counts[2, k], self._min_rate_hz)
        }
        if _is_unsigned(self._signs[2], self._signs[3]):
            found.setdefault("V5", _UNSIGNED)
        return found


@kernel
def _repeats(moving_s: float, samples: float, changes: float, min_rate_hz: float) -> bool:
    if moving_s < _DECIDED_S:
        return False
    return changes < min_rate_hz * moving_s and changes < _CHANGED_SHARE * samples


@kernel
def _count(
    time_s: Array1, values: Array2, last: Array1, counts: Array2, min_rate_hz: float, refused: Flags2
) -> None:
    for i in range(time_s.size):
        step_s = time_s[i] - last[-1]
        for k in _JUDGED:
            value = values[i, k]
            if np.isnan(value):
                continue
            moves = False
            for other in (_V3, *_SPEEDS):
                if other != k and not (k in _SPEEDS and other in _SPEEDS):
                    here, before = values[i, other], last[other]
                    moves |= here != before and not np.isnan(here) and not np.isnan(before)
            # A shaft at rest has a speed of zero again and again.
            moves &= value != 0.0 or k not in _SPEEDS
            if moves and 0.0 < step_s <= _LONGEST_STEP_S and not np.isnan(last[k]):
                counts[0, k] += step_s
                counts[1, k] += 1.0
                counts[2, k] += value != last[k]
            refused[i, k] = _repeats(counts[0, k], counts[1, k], counts[2, k], min_rate_hz)
            # Before it is decided, a register's repetitions must not enter a fit of a few samples.
            early = counts[0, k] < _DECIDED_S and counts[2, k] < _CHANGED_SHARE * counts[1, k]
            refused[i, k] |= early and k in (_V5, _V8) and moves and value == last[k]
        for k in range(values.shape[1]):
            if not np.isnan(values[i, k]):
                last[k] = values[i, k]
        last[-1] = time_s[i]


@kernel
def _is_unsigned(contradictions: float, negative: float) -> bool:
    return contradictions >= _UNSIGNED_SAMPLES and negative == 0.0


@kernel
def _unsigned(values: Array2, signs: Array1, refused: Flags2) -> None:
    for i in range(len(values)):
        volts, amperes, speed = values[i, _V4], values[i, _V5], values[i, _V7]
        if np.isnan(speed):
            speed = values[i, _V10]
        if np.isnan(volts) or np.isnan(amperes) or np.isnan(speed):
            refused[i, _V5] |= _is_unsigned(signs[2], signs[3])
            continue
        signs[0] = max(signs[0], abs(volts))
        signs[1] = max(signs[1], abs(speed))
        stands = abs(speed) < _STANDING_SHARE * signs[1]
        signs[2] += stands and volts < -_LOADED_SHARE * signs[0] and amperes > 0.0
        signs[3] += amperes < 0.0
        refused[i, _V5] |= _is_unsigned(signs[2], signs[3])


def refreshed(rate_hz: float) -> str:
    """Return how often a register is refreshed, as text.

    Examples
    --------
    >>> refreshed(0.94), refreshed(2.4), refreshed(0.1)
    ('refreshed once a second', 'refreshed 2.4 times a second', 'refreshed once in 10 s')
    """
    if rate_hz <= 0.0:
        return "never refreshed"
    if rate_hz < 0.75:
        return f"refreshed once in {1.0 / rate_hz:.0f} s"
    return "refreshed once a second" if rate_hz < 1.5 else f"refreshed {rate_hz:.2g} times a second"


def not_used(provenance: Mapping[str, str]) -> dict[str, str]:
    """Return why a quantity is no evidence, by key, from the provenance of all.

    Examples
    --------
    >>> not_used({"V4": "A.b", "V5": "A.c (not used: the current is refreshed once a second)"})
    {'V5': 'the current is refreshed once a second'}
    """
    begin, end = NOT_USED.split("{}")
    return {key: how.partition(begin)[2].removesuffix(end) for key, how in provenance.items() if begin in how}
