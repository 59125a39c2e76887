"""The highest sustained value of a quantity over a flight, in constant memory."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

__all__ = ["RESOLUTION", "Peak"]

RESOLUTION = 0.01
"""Relative width of a step of the histogram."""

_SHARE = 0.999
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
        total = int(self._counts.sum())
        if not total:
            return 0.0
        step = int(np.searchsorted(self._counts.cumsum(), ceil(_SHARE * total)))
        return float(_LEAST * np.exp((step + 0.5) * RESOLUTION)) if step else 0.0
