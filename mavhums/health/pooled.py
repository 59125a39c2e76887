"""Standard errors pooled with those of the flight so far.

The error of one window is uncertain, because it rests on ten slots; its tails are heavy. The error pooled
over earlier windows is more certain. The larger of the two is used, because the air may have become rougher.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.health.detector import Estimates
from mavhums.health.windows import WINDOW_SLOTS

__all__ = ["PooledErrors"]

_MOST_FREEDOM = 36.0

Array = NDArray[np.float64]


class PooledErrors:
    """Pools the errors of each quantity's windows incrementally."""

    def __init__(self) -> None:
        self._sum: Array = np.zeros(1)
        self._count: NDArray[np.int64] = np.zeros(1, dtype=np.int64)

    def feed(self, estimates: Estimates) -> Estimates:
        """Return the estimates with pooled errors and the resulting degrees of freedom.

        Estimates of several quantities have the shape (d, k).
        """
        shown = np.isfinite(estimates.value)
        if not shown.size:
            return estimates
        squares = np.where(shown, estimates.error**2, 0.0)
        total = squares.copy()
        total[..., :1] += self._sum
        total = total.cumsum(axis=-1)
        count = self._count + shown.cumsum(axis=-1)
        self._sum, self._count = total[..., -1:], count[..., -1:]
        freedom, error = estimates.freedom, estimates.error
        before = np.minimum(freedom * (count // WINDOW_SLOTS), _MOST_FREEDOM)
        pooled = (freedom * squares + before * total / np.maximum(count, 1)) / (freedom + before)
        return Estimates(estimates.value, np.maximum(error, np.sqrt(pooled)), freedom + before)
