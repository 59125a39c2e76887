"""The highest sustained value of a quantity over a flight, in constant memory."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from mavhums.report.assessment import Interval

__all__ = ["RESOLUTION", "Peak"]

RESOLUTION = 0.01
"""Relative width of a step of the histogram."""

_ABOVE = 0.001
_NORMAL_95 = 1.96
_LEAST, _STEPS = 1e-4, 3200  # up to about 8e9

Array = NDArray[np.float64]


class Peak:
    """Collects the absolute values that 99.9 % of a flight's samples do not exceed.

    One sample in a thousand may lie above: a spike is no load. The counts do not depend on the order of the
    samples, nor on how they are cut into blocks.

    Examples
    --------
    >>> peak = Peak()
    >>> peak.feed(np.array([*np.linspace(-2.0, 2.0, 5000), 50.0]))
    >>> round(peak.value, 1)
    2.0
    """

    def __init__(self) -> None:
        self._counts = np.zeros(_STEPS, dtype=np.int64)

    def feed(self, values: Array) -> None:
        """Take finite values, shape (n,)."""
        steps = np.log(np.maximum(np.abs(values), _LEAST) / _LEAST) / RESOLUTION
        self._counts += np.bincount(np.minimum(steps.astype(np.int64), _STEPS - 1), minlength=_STEPS)

    @property
    def value(self) -> float:
        """The value, to within :data:`RESOLUTION`; zero before the first sample."""
        return self._exceeded_by(_ABOVE * self._total)

    @property
    def interval(self) -> Interval:
        """The value with its 95 % interval: how many of independent samples exceed it is left to chance."""
        above = _ABOVE * self._total
        half = _NORMAL_95 * above**0.5
        low, high = self._exceeded_by(above + half), self._exceeded_by(max(above - half, 0.0))
        low, estimate, high = (float(f"{number:.4g}") for number in (low, self.value, high))
        return Interval(estimate=estimate, low=low, high=high)

    @property
    def _total(self) -> int:
        return int(self._counts.sum())

    def _exceeded_by(self, samples: float) -> float:
        """Return the largest value that at most so many samples exceed; zero of values below the least."""
        rank = max(ceil(self._total - samples), 1)
        step = int(np.searchsorted(self._counts.cumsum(), rank))
        return float(_LEAST * np.exp((step + 0.5) * RESOLUTION)) if 0 < step < _STEPS else 0.0
