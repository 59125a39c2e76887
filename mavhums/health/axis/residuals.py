"""Residuals of a regression on the flight's own beginning: over three seconds, in standard deviations."""

from __future__ import annotations

from collections import deque
from math import exp
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np

from mavhums.core.arrays import Array, Array1, Flags
from mavhums.core.kernels import kernel
from mavhums.health.axis.regressions import STEP_S, hold_last
from mavhums.health.axis.thresholds import (
    FASTEST_ROLL_DEG_S,
    LEAST_ROWS_PER_S,
    LONGEST_REFERENCE_S,
    NOSE_RISES_DEG_S,
    OFFSET_SPREAD_RAD,
    REFERENCE_S,
    RESPONSE_RAD_S,
    SHIFT_S,
    SIDE_FORCE_FLOOR_M_S2,
    SLOW_STREAM_S,
    TRACKING_FLOOR_RAD,
)
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows

_FREE: Final = 1e9  # no prior
_ROLLS_RAD_S: Final = float(np.radians(FASTEST_ROLL_DEG_S))
_RISES_RAD_S: Final = float(np.radians(NOSE_RISES_DEG_S))


@kernel
def _followed(values: Array1, coefficients: Array1, state: Array1) -> Array:
    """Return the second-order recursion b1, b2, a1, a2 over values; the state is updated."""
    b1, b2, a1, a2 = coefficients
    out = np.empty_like(values)
    for k in range(values.size):
        y = state[0]
        out[k] = y
        state[0] = state[1] + b1 * values[k] - a1 * y
        state[1] = b2 * values[k] - a2 * y
    return out


@kernel
def _slewed(values: Array1, step: float, before: float) -> Array:
    """Return values that change by at most ``step`` from one to the next, after ``before``."""
    out = np.empty_like(values)
    for k in range(values.size):
        before += min(max(values[k] - before, -step), step)
        out[k] = before
    return out


class AttitudeResponse:
    """The response of a controlled attitude: second order, ``omega`` rad/s, critically damped.

    Parameters
    ----------
    omega
        Natural frequency, rad/s.
    rate
        Fastest change that is expected of the aircraft, rad/s.
    """

    def __init__(self, omega: float, rate: float = np.inf) -> None:
        self._step = rate * STEP_S
        step = omega * STEP_S
        e = exp(-step)
        self._coefficients = np.array([1 - e * (1 + step), e**2 + e * (step - 1), -2 * e, e**2])
        self._last: float | None = None
        self._slewed = 0.0
        self._state = np.zeros(2)

    def feed(self, values: Array) -> Array:
        """Return the expected attitude, shape (n,)."""
        if self._last is None:
            finite = values[np.isfinite(values)]
            self._last = self._slewed = float(finite[0]) if finite.size else 0.0
            _, b2, _, a2 = self._coefficients
            self._state = np.array([1.0, b2 - a2]) * self._last
        filled = hold_last(values, self._last)
        self._last = float(filled[-1])
        slewed = _slewed(filled, self._step, self._slewed)
        self._slewed = float(slewed[-1])
        return _followed(slewed, self._coefficients, self._state)


class ResidualModel(Protocol):
    """A regression whose residual is monitored.

    Attributes
    ----------
    kind
        Whether the mean of the residual counts, or its root mean square.
    floor
        Smallest standard deviation of the residual: a calm reference does not guarantee a calm flight.
    spreads
        Standard deviation of each coefficient about zero, as a prior; infinite if unknown.
    """

    kind: Literal["mean", "rms"]
    floor: float
    spreads: tuple[float, ...]

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the regressors (n, m), the response (n,), and the usable rows; the state is updated."""
        ...


class Deviation(NamedTuple):
    """The residual over the three seconds that end at ``end_s``; NaN if it is not known."""

    end_s: int
    value: float
    deviations: float


class Residual:
    """Tracks the residual of one model."""

    def __init__(self, model: ResidualModel) -> None:
        self._model = model
        self._design: list[Array] = []
        self._answer: list[Array] = []
        self._rows = 0
        self._window: deque[tuple[float, int]] = deque(maxlen=SHIFT_S)
        self._beta: Array | None = None
        self.deviation = np.nan
        self.since_s = 0

    def feed(self, rows: Rows) -> list[Deviation]:
        """Process rows; return the residuals of their seconds once the reference is complete."""
        if rows.fresh:
            self._window.clear()
        design, answer, good = self._model.feed(rows)
        first = self._wait(rows.second, design, answer, good) if self._beta is None else 0
        seconds = ((k, slice(k * RATE_HZ, (k + 1) * RATE_HZ)) for k in range(first, rows.seconds))
        return [self._second(rows.second + k + 1, design[at], answer[at], good[at]) for k, at in seconds]

    def _wait(self, second: int, design: Array, answer: Array, good: Flags) -> int:
        """Collect whole seconds for the reference; return the number of those that it needed."""
        usable = self._rows + good.reshape(-1, RATE_HZ).sum(axis=1).cumsum()
        complete = int(np.searchsorted(usable, REFERENCE_S * RATE_HZ))
        # The reference ends with a whole second, so that it does not depend on the block.
        taken = min(complete + 1, len(usable))
        at = np.flatnonzero(good[: taken * RATE_HZ])
        self._design.append(design[at])
        self._answer.append(answer[at])
        self._rows += len(at)
        if complete < len(usable):
            self._refer(second + taken)
        return taken

    def _refer(self, end_s: int) -> None:
        """Fit the reference, which ends with this second, to the collected rows."""
        x, y = np.concatenate(self._design), np.concatenate(self._answer)
        own = self._model.floor
        weights = np.array([own / spread for spread in self._model.spreads]) * np.sqrt(RATE_HZ)
        x_wide = np.vstack([x, np.diag(weights)])
        self._beta = np.linalg.lstsq(x_wide, np.append(y, np.zeros(len(weights))), rcond=None)[0]
        # A calm beginning would make every gust of the rest an alarm.
        self.deviation = max(float((y - x @ self._beta).std()), own)
        self.since_s = end_s
        self._design.clear()
        self._answer.clear()

    def _second(self, end_s: int, design: Array, answer: Array, good: Flags) -> Deviation:
        assert self._beta is not None
        model = sum((design[:, k] * b for k, b in enumerate(self._beta)), start=np.zeros(len(answer)))
        left = np.where(good, answer - model, 0.0)
        rms = self._model.kind == "rms"
        self._window.append((float((left * left if rms else left).sum()), int(good.sum())))
        total, count = np.array(self._window).sum(axis=0)
        # After a gap three seconds must pass, for two have fewer rows: their mean is a gust.
        if count < SHIFT_S * LEAST_ROWS_PER_S:
            return Deviation(end_s, np.nan, np.nan)
        value = float(np.sqrt(total / count)) if rms else float(total / count)
        return Deviation(end_s, value, abs(value) / self.deviation)


def _follows(rows: Rows) -> Flags:
    """Return where the demanded attitude comes often enough that it is known when it changes."""
    return np.asarray(rows.demand_spacing <= SLOW_STREAM_S)


class RollTracking:
    """``φ − (demanded φ through a second order of 2.5 rad/s)``, with a learned offset.

    A reversal of 110° takes an aircraft seconds, and a calm beginning does not show how many: it may follow
    at 45°/s as well.
    """

    kind: Literal["mean", "rms"] = "rms"
    floor = TRACKING_FLOOR_RAD
    spreads: tuple[float, ...] = (OFFSET_SPREAD_RAD,)

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._responses = (
            AttitudeResponse(RESPONSE_RAD_S),
            AttitudeResponse(RESPONSE_RAD_S, _ROLLS_RAD_S),
        )

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the offset's regressor, the roll residual, and the mask of flight rows with both."""
        if rows.fresh:
            self._begin()
        expected = [rows.roll_demand, *(response.feed(rows.roll_demand) for response in self._responses)]
        # Between the demanded and the expected angles the aircraft follows; it may be quicker than expected.
        answer = rows.roll - np.clip(rows.roll, np.fmin.reduce(expected), np.fmax.reduce(expected))
        good = rows.flying & _follows(rows) & np.isfinite(rows.roll_demand) & np.isfinite(answer)
        return np.ones((len(rows), 1)), answer, good


class _OwnSpeed:
    """The median airspeed of the first two minutes of flight."""

    def __init__(self) -> None:
        self._speeds: list[Array] = []
        self.value = np.nan

    def feed(self, rows: Rows) -> Array:
        """Return the median up to each row's second, shape (n,), m/s.

        It is found second by second: a value that later seconds of the same block have changed would make
        the verdict depend on how the log is divided into blocks.
        """
        values = np.empty(rows.seconds)
        seconds = zip(rows.speed.reshape(-1, RATE_HZ), rows.flying.reshape(-1, RATE_HZ), strict=True)
        for k, (speed, flying) in enumerate(seconds):
            if len(self._speeds) < LONGEST_REFERENCE_S and flying.any():
                self._speeds.append(speed[flying])
                self.value = float(np.nanmedian(np.concatenate(self._speeds)))
            values[k] = self.value
        return np.repeat(values, RATE_HZ)


class PitchTracking:
    """``θ − (demanded θ through a second order of 2.5 rad/s)``, less its part in turns.

    An aircraft slower than usual with its nose below the demand may have stalled, or lost its engine. When
    the speed is back, a working elevator raises the nose at 5°/s or more. What lies between this recovery and
    the demand is no evidence, what is below it counts.
    """

    kind: Literal["mean", "rms"] = "rms"
    floor = TRACKING_FLOOR_RAD
    spreads: tuple[float, ...] = (OFFSET_SPREAD_RAD, OFFSET_SPREAD_RAD)

    def __init__(self) -> None:
        self._begin()
        self._own = _OwnSpeed()

    def _begin(self) -> None:
        self._response = AttitudeResponse(RESPONSE_RAD_S)
        self._recovered = np.inf

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the regressors 1 and sin² φ, the pitch residual, and the mask of flight rows with both."""
        if rows.fresh:
            self._begin()
        expected = self._response.feed(rows.pitch_demand)
        recovery = np.minimum(self._recovery(rows, self._own.feed(rows)), expected)
        answer = rows.pitch - np.clip(rows.pitch, recovery, expected)
        good = rows.flying & _follows(rows) & np.isfinite(rows.pitch_demand) & np.isfinite(answer)
        turning = np.nan_to_num(np.sin(rows.roll)) ** 2
        return np.column_stack([np.ones(len(rows)), turning]), answer, good

    def _recovery(self, rows: Rows, own: Array) -> Array:
        """Return the pitch that a nose which was low in slow flight has since regained at least, (n,)."""
        stalls = (rows.pitch < rows.pitch_demand) & (rows.speed < own)
        at = np.arange(len(rows))
        last = np.maximum.accumulate(np.where(stalls, at, -1))
        begun = np.where(last < 0, self._recovered, rows.pitch[last])
        recovery: Array = begun + _RISES_RAD_S * STEP_S * (at - last)
        self._recovered = float(recovery[-1])
        return recovery


class SideForce:
    """The side force without its part in turns, as caused by a deflected rudder or a skid.

    It is that of one accelerometer: the offset of another one looks like a skid.
    """

    kind: Literal["mean", "rms"] = "mean"
    floor = SIDE_FORCE_FLOOR_M_S2
    spreads: tuple[float, ...] = (_FREE, _FREE, _FREE)

    def __init__(self) -> None:
        self._source = np.nan

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the regressors 1, sin φ and yaw rate, the side force, and the mask of usable flight rows."""
        columns = np.column_stack([np.ones(len(rows)), np.sin(rows.roll), rows.yaw_rate])
        good = rows.flying & np.isfinite(columns).all(axis=1) & np.isfinite(rows.side_force)
        if np.isnan(self._source) and good.any():
            self._source = float(rows.force_source[np.argmax(good)])
        good &= rows.force_source == self._source
        return np.nan_to_num(columns), np.nan_to_num(rows.side_force), good
