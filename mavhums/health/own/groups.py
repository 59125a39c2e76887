"""Sums of a flight in up to sixteen parts of equal length, in bounded memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Groups"]

_MOST = 16

Array = NDArray[np.float64]


class Groups:
    """Collects the sums of windows.

    Attributes
    ----------
    parts
        Number of samples and sums of each part, in time order.

    Examples
    --------
    >>> groups = Groups()
    >>> for _ in range(40):
    ...     groups.add(10, np.ones((1, 1)))
    >>> [count for count, _ in groups.parts]
    [40, 40, 40, 40, 40, 40, 40, 40, 40, 40]
    """

    def __init__(self) -> None:
        self.parts: list[tuple[int, Array]] = []
        self._of_part, self._in_part = 1, 0

    def add(self, count: int, sums: Array) -> None:
        """Add one window's number of samples, and its sums."""
        if self._in_part == self._of_part:
            self._in_part = 0
            if len(self.parts) == _MOST:
                pairs = zip(self.parts[::2], self.parts[1::2], strict=True)
                self.parts = [(a + b, first + second) for (a, first), (b, second) in pairs]
                self._of_part *= 2
        if self._in_part == 0:
            self.parts.append((count, sums))
        else:
            before = self.parts[-1]
            self.parts[-1] = (before[0] + count, before[1] + sums)
        self._in_part += 1
