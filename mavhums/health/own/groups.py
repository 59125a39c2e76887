"""Sums of a flight in up to sixteen parts of equal length, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Groups"]

_MOST = 16

Array = NDArray[np.float64]


class Groups:
    """Collects the sums of windows.

    Parameters
    ----------
    joined
        Applied to the sums of a window before they are added to another's.

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

    def __init__(self, joined: Callable[[Array], Array] = np.asarray) -> None:
        self._joined = joined
        self.parts: list[tuple[int, Array]] = []
        self._of_part, self._in_part = 1, 0

    def add(self, count: int, sums: Array) -> None:
        """Add one window's number of samples, and its sums."""
        if self._in_part == self._of_part:
            self._in_part = 0
            if len(self.parts) == _MOST:
                pairs = zip(self.parts[::2], self.parts[1::2], strict=True)
                self.parts = [self._sum(first, second) for first, second in pairs]
                self._of_part *= 2
        if self._in_part == 0:
            self.parts.append((count, sums))
        else:
            self.parts[-1] = self._sum(self.parts[-1], (count, sums))
        self._in_part += 1

    def _sum(self, one: tuple[int, Array], other: tuple[int, Array]) -> tuple[int, Array]:
        return one[0] + other[0], self._joined(one[1]) + self._joined(other[1])
