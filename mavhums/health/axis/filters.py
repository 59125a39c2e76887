"""Filters over grid rows that keep their state, so that rows may be divided into any blocks."""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.kernels import kernel
from mavhums.vehicle.grid import RATE_HZ

_STEP_S: Final = 1.0 / RATE_HZ


def hold_last(values: Array, before: float) -> Array:
    """Replace values that are not finite by the previous value; ``before`` precedes the first."""
    rows = np.where(np.isfinite(values), np.arange(values.size), -1)
    last = np.maximum.accumulate(rows)
    return np.where(last < 0, before, values[np.maximum(last, 0)])


@kernel
def _smoothed(values: Array, share: float, before: float) -> Array:
    """Return ``y[k] = y[k-1] + share · (values[k] - y[k-1])``, whose ``y[-1]`` is ``before``."""
    out = np.empty_like(values)
    for k in range(values.size):
        before += share * (values[k] - before)
        out[k] = before
    return out


@kernel
def _followed(values: Array, coefficients: Array, state: Array) -> Array:
    """Return the second-order recursion b1, b2, a1, a2 over values; the state is updated."""
    b1, b2, a1, a2 = coefficients
    out = np.empty_like(values)
    for k in range(values.size):
        y = state[0]
        out[k] = y
        state[0] = state[1] + b1 * values[k] - a1 * y
        state[1] = b2 * values[k] - a2 * y
    return out


class Lag:
    """A first-order lag with the time constant ``tau_s``; at zero the output is the input."""

    def __init__(self, tau_s: float) -> None:
        self._share = 1.0 - exp(-_STEP_S / tau_s) if tau_s > 0 else 1.0
        self._last: float | None = None
        self._value = 0.0

    def feed(self, values: Array) -> Array:
        """Return the lagged values, shape (n,); missing values are replaced by the last one."""
        if self._last is None:
            finite = values[np.isfinite(values)]
            self._last = self._value = float(finite[0]) if finite.size else 0.0
        filled = hold_last(values, self._last)
        self._last = float(filled[-1])
        out = _smoothed(filled, self._share, self._value)
        self._value = float(out[-1])
        return out


@kernel
def _slewed(values: Array, step: float, before: float) -> Array:
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
        self._step = rate * _STEP_S
        step = omega * _STEP_S
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


class HighPass:
    """A high-pass filter: subtracts the mean over the last ``memory_s``."""

    def __init__(self, memory_s: float) -> None:
        self._share = 1.0 - exp(-_STEP_S / memory_s)
        self._slow = 0.0

    def feed(self, values: Array) -> Array:
        """Return values (n,) without their slow part."""
        slow = _smoothed(np.ascontiguousarray(values), self._share, self._slow)
        self._slow = float(slow[-1])
        return np.asarray(values - slow)


class Tail:
    """Buffers the last rows of columns, for delays and moving means.

    Parameters
    ----------
    columns
        Number m of columns.
    rows
        Number of past rows that are needed.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self._kept = np.full((rows, columns), np.nan)

    def feed(self, values: Array) -> Array:
        """Return the buffered rows followed by these, shape (rows + n, m)."""
        joined = np.concatenate([self._kept, values])
        self._kept = joined[len(joined) - len(self._kept) :]
        return joined
