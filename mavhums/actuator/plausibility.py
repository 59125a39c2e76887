"""Which readings of a servo are no evidence: impossible, repeated, without their sign, or of several servos.

A register that a servo refreshes once a second is sent with every message. While the shaft moves, a quantity
that is sampled changes; one that only repeats itself is no evidence, whatever the rate of the messages.

A motor at rest takes a current of the sign of its voltage. A current that is positive at either sign is a
magnitude, and no equation that needs signs holds for it.

Servos that share an id report in turn, nearly at the same time: the angle leaps to and fro, faster than any
servo turns. How the angle follows from the pulse is a line, fitted to the first seconds in which both move
together, and then held: a shaft that stops later does not follow it. A shaft that does not follow from the
beginning has no line, which is reported where the pulse moved.

The counts run from sample to sample, so that the division of the log into blocks does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.telemetry import Reading
from mavhums.core.arrays import Array, Array1, Array2, Flags, Flags2, Integers
from mavhums.core.kernels import kernel
from mavhums.core.quantities import KEYS, column

NOT_USED: Final = " (not used: {})"
"""What the provenance of a quantity that is no evidence ends with."""

_JUDGED: Final = tuple(column(key) for key in ("V4", "V5", "V7", "V8", "V10"))
_NAMES: Final = {"V4": "voltage", "V5": "current", "V7": "speed", "V8": "torque", "V10": "shaft's speed"}
_SPEEDS: Final = tuple(column(key) for key in ("V7", "V10"))
_V1, _V3, _V4, _V5, _V7, _V8, _V10 = (column(f"V{k}") for k in (1, 3, 4, 5, 7, 8, 10))
_LONGEST_STEP_S: Final = 0.5
"""A longer step between samples is a pause of the telemetry, in which nothing could change."""

_DECIDED_S: Final = 2.0
"""Motion after which a quantity may count as repeated, s: less would call two equal readings a register that
does not change, more would let a register's first readings count. By hand; a healthy current changes within
0.1 s."""

_CHANGED_SHARE: Final = 0.25
"""Share of samples that change from which a quantity is sampled however slow the log is. A register refreshed
once a second changes in 1 % of the samples at 100 Hz and in 20 % at 5 Hz."""

_UNSIGNED_SAMPLES: Final = 5
"""Samples at standstill whose voltage is negative and whose current is not, from which on a current that was
never negative is a magnitude: one may be noise of the voltage. By hand."""

_REST_SHARE: Final = 0.02
"""Share of the highest speed so far below which the shaft is at rest: so small is its back-EMF."""

_LOADED_SHARE: Final = 0.1
"""Share of the highest voltage so far above which a motor at rest is loaded: less is noise."""

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
        at_rest = abs(speed) < _REST_SHARE * signs[1]
        signs[2] += at_rest and volts < -_LOADED_SHARE * signs[0] and amperes > 0.0
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


_FASTEST_DEG_S: Final = 2000.0  # the fastest servos of models take 0.03 s for 60°
_LEAST, _SHARE = 20, 0.25
"""Leaps, and their share of the samples, that show several servos; of two, up to half of the samples leap."""
_SAMPLES: Final = 500  # that a line rests on: 10 s at 50 Hz
_MOVES_DEG: Final = 1.0  # standard deviation of what moves: less is noise
_TOGETHER: Final = 0.95  # correlation from which the shaft follows: its lag costs a few hundredths
_APART: Final = 0.3  # correlation, of either sign, below which the angle has nothing of the pulse


class OneServo:
    """Counts the leaps of one actuator's angle."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, float]] = {}
        self._steps = self._leaps = 0

    @property
    def shared(self) -> bool:
        """Whether the angles so far are those of several servos."""
        return self._leaps >= max(_LEAST, _SHARE * self._steps)

    def feed(self, readings: Sequence[Reading], loose: Integers | None) -> None:
        """Take new readings; of the frames ``loose`` the time is not certain."""
        for reading in readings:
            angle, frame = reading.values[:, _V3], reading.frame
            known = np.isfinite(angle) & ~np.isin(frame, [] if loose is None else loose)
            if not known.any():
                continue
            time_us, angle = reading.utc_us[known], angle[known]
            last = self._last.get(reading.source, (int(time_us[0]), float(angle[0])))
            passed_s = np.diff(time_us, prepend=last[0]) * 1e-6
            leaps = np.abs(np.diff(angle, prepend=last[1])) > _FASTEST_DEG_S * passed_s
            self._steps += passed_s.size
            self._leaps += int((leaps & (passed_s >= 0.0)).sum())
            self._last[reading.source] = int(time_us[-1]), float(angle[-1])


class Travel:
    """Converts the pulses of one actuator to angles, block after block."""

    def __init__(self) -> None:
        self._sums = np.zeros(6)  # number, and sums of pulse, angle, and their squares and product
        self._line: tuple[float, float] | None = None

    @property
    def never_follows(self) -> bool:
        """Whether the pulse moved so far and the angle did not go with it, in whatever unit it is."""
        count, x, y, xx, yy, xy = self._sums
        across, along, joint = count * xx - x * x, count * yy - y * y, count * xy - x * y
        along = max(along, 1e-9 * count * yy)  # of an angle that is one number only rounding is left
        moves = count >= _SAMPLES and across > (_MOVES_DEG * count) ** 2
        return self._line is None and bool(moves and joint * joint <= _APART**2 * across * along)

    def scale(self, values: Array, by_pulse: Flags) -> bool:
        """Replace V1 of V1…V12, shape (n, 12), where it is a pulse; NaN until the line is known.

        Return whether it is known.
        """
        rows = np.flatnonzero(by_pulse[:, _V1])
        pulse, angle = values[rows, _V1], values[rows, _V3]
        values[rows, _V1] = np.nan
        first = 0
        if self._line is None:
            both = np.isfinite(angle)
            x, y = np.where(both, pulse, 0.0), np.where(both, angle, 0.0)
            columns = np.stack([both, x, y, x * x, y * y, x * y], axis=1)
            sums = np.cumsum(np.vstack([self._sums, columns]), axis=0)
            self._sums = sums[-1]
            count, x, y, xx, yy, xy = sums[1:].T
            across, along, joint = count * xx - x * x, count * yy - y * y, count * xy - x * y
            moves = np.minimum(across, along) > (_MOVES_DEG * count) ** 2
            known = np.flatnonzero(
                (count >= _SAMPLES) & moves & (joint * joint >= _TOGETHER**2 * across * along)
            )
            if not known.size:
                return False
            first = int(known[0])
            slope = joint[first] / across[first]
            self._line = float(slope), float((y[first] - slope * x[first]) / count[first])
        values[rows[first:], _V1] = self._line[0] * pulse[first:] + self._line[1]
        return True


_MARGIN = 3.0
"""Times the largest value that the profile allows: for sensors, faults and data sheets. Less refuses a faulty
actuator's values, more lets damaged telemetry through."""
_OFFSET = 10.0  # an unwrapped angle has an arbitrary start
_BACK_DRIVEN = 10.0  # times the stall torque: largest load of air and end stops on the gear
_LEAST_TRAVEL_DEG = 180.0  # least bound of an angle: a sensor may be mounted with any zero
_RPM = 60 / (2 * np.pi)
_LARGEST = {
    "V1": 720.0,
    "V2": 1e7,
    "V3": 720.0,
    "V4": 1000.0,
    "V5": 1000.0,
    "V6": 1e6,
    "V7": 2e5,
    "V8": 1e3,
    "V9": 1e6,
    "V10": 2e4,
    "V11": 1e5,
    "V12": 1e6,
}
"""What no unmanned aircraft reaches, where the profile lacks a constant."""


def bounds(actuator: Actuator) -> Array:
    """Return the largest magnitude that each of V1…V12 can have, shape (12,).

    It follows from the profile: the travel; the supply voltage U, at the motor's terminals; the stall current
    U/R; the no-load speed U/k_t; and the resulting torques and powers.

    Examples
    --------
    >>> from mavhums.actuator.profile import load_airframe
    >>> of = dict(zip(KEYS, bounds(load_airframe("paper").actuators[0]).round(1).tolist(), strict=True))
    >>> of["V1"], of["V4"], of["V5"], of["V7"]
    (180.0, 81.0, 3.6, 52950.5)
    """
    most = dict(_LARGEST)
    if actuator.travel_deg is not None:
        most["V1"] = most["V3"] = max(_MARGIN * max(map(abs, actuator.travel_deg)), _LEAST_TRAVEL_DEG)
    ema = actuator.ema
    if ema is not None:
        volts = _MARGIN * ema.supply_voltage if ema.supply_voltage is not None else most["V4"]
        amps, rpm = volts / ema.resistance, volts / ema.torque_constant * _RPM
        stall = ema.torque_constant * ema.gear_ratio * amps
        most |= {
            "V2": _OFFSET * most["V3"] * ema.gear_ratio,
            "V4": volts,
            "V5": amps + _MARGIN * actuator.electronics_a,
            "V7": rpm,
            "V8": ema.torque_constant * amps,
            "V10": rpm / ema.gear_ratio,
            "V11": _BACK_DRIVEN / _MARGIN * stall,
        }
        most["V6"] = most["V4"] * most["V5"]
        most["V9"] = most["V8"] * most["V7"] / _RPM
        most["V12"] = most["V11"] * most["V10"] / _RPM
    return np.array([most[key] for key in KEYS])


class Gate:
    """Removes implausible values from one actuator's readings, and counts them.

    Attributes
    ----------
    given, refused
        Number of values of each quantity, and number of removed ones, shape (12,).
    """

    def __init__(self, actuator: Actuator) -> None:
        self.given = np.zeros(len(KEYS), dtype=np.int64)
        self.refused = np.zeros(len(KEYS), dtype=np.int64)
        self._bounds = bounds(actuator)

    def admit(self, values: Array) -> Array:
        """Return V1…V12, shape (n, 12), with NaN for implausible values.

        NaN means that a quantity was not measured; infinity is a value, and implausible.
        """
        size = np.abs(values)
        given = ~np.isnan(values)
        refused = size > self._bounds
        self.given += given.sum(axis=0)
        if not refused.any():
            return values
        self.refused += refused.sum(axis=0)
        return np.where(refused, np.nan, values)
