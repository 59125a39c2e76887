"""Standard errors steadied by those of the flight so far.

The error of one window is itself uncertain: it rests on ten slots, and its tails are heavy. Together with the
windows before it is not; where it is the larger of the two it stands, for the air may have become rougher.
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
    """Pools the errors of each quantity's windows as they come."""

    def __init__(self) -> None:
        self._sum: Array = np.zeros(1)
        self._count: NDArray[np.int64] = np.zeros(1, dtype=np.int64)

    def feed(self, estimates: Estimates) -> Estimates:
        """Return the estimates with steadier errors, and the degrees of freedom that this gives them.

        Several quantities may lie in one, shape (d, k).
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
