"""Filters over grid rows that carry their state on, so that rows may come in any pieces."""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from mavhums.vehicle.grid import RATE_HZ

__all__ = ["Following", "HighPass", "Lag", "Tail", "held"]

Array = NDArray[np.float64]

_STEP_S: Final = 1.0 / RATE_HZ


def held(values: Array, before: float) -> Array:
    """Fill what is not finite with the value before it; ``before`` stands before the first."""
    rows = np.where(np.isfinite(values), np.arange(values.size), -1)
    last = np.maximum.accumulate(rows)
    return np.where(last < 0, before, values[np.maximum(last, 0)])


class Lag:
    """A first-order lag of the time constant ``tau_s``; at zero it passes its input on."""

    def __init__(self, tau_s: float) -> None:
        self._share = 1.0 - exp(-_STEP_S / tau_s) if tau_s > 0 else 1.0
        self._last: float | None = None
        self._state = np.zeros(1)

    def feed(self, values: Array) -> Array:
        """Return the lagged values, shape (n,); where there are none the last one holds."""
        if self._last is None:
            finite = values[np.isfinite(values)]
            self._last = float(finite[0]) if finite.size else 0.0
            self._state = np.array([(1.0 - self._share) * self._last])
        filled = held(values, self._last)
        self._last = float(filled[-1])
        out, self._state = lfilter([self._share], [1.0, self._share - 1.0], filled, zi=self._state)
        return np.asarray(out)


class Following:
    """How a controlled attitude follows its demand: second order, ``omega`` rad/s, critically damped."""

    def __init__(self, omega: float) -> None:
        b, a, _ = cont2discrete((np.array([omega**2]), np.array([1.0, 2.0 * omega, omega**2])), _STEP_S)
        self._b, self._a = b.ravel(), a
        self._last: float | None = None
        self._state = np.zeros(2)

    def feed(self, values: Array) -> Array:
        """Return the attitude to be expected, shape (n,)."""
        if self._last is None:
            finite = values[np.isfinite(values)]
            self._last = float(finite[0]) if finite.size else 0.0
            self._state = _steady(self._b, self._a) * self._last
        filled = held(values, self._last)
        self._last = float(filled[-1])
        out, self._state = lfilter(self._b, self._a, filled, zi=self._state)
        return np.asarray(out)


def _steady(b: Array, a: Array) -> Array:
    from scipy.signal import lfilter_zi

    return np.asarray(lfilter_zi(b, a))


class HighPass:
    """What is left of values when their mean over the last ``memory_s`` is taken away."""

    def __init__(self, memory_s: float) -> None:
        self._share = 1.0 - exp(-_STEP_S / memory_s)
        self._state = np.zeros(1)

    def feed(self, values: Array) -> Array:
        """Return values (n,) without their slow part."""
        slow, self._state = lfilter([self._share], [1.0, self._share - 1.0], values, zi=self._state)
        return np.asarray(values - slow)


class Tail:
    """Keeps the last rows of columns, for delays and means over the past.

    Parameters
    ----------
    columns
        Number m of columns.
    rows
        How many rows back are needed.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self._kept = np.full((rows, columns), np.nan)

    def feed(self, values: Array) -> Array:
        """Return the kept rows and after them these, shape (rows + n, m)."""
        joined = np.concatenate([self._kept, values])
        self._kept = joined[len(joined) - len(self._kept) :]
        return joined
