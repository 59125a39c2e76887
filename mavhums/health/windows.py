"""Sliding window over an actuator's slots: the sums of the last S slots, for each complete slot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["WINDOW_SLOTS", "Windows"]

WINDOW_SLOTS = 10

Array = NDArray[np.float64]


class Windows:
    """Buffers the sums of the last slots.

    Parameters
    ----------
    columns
        Number m of sums of a slot.
    slots
        Number of slots in a window, S.
    empty
        Value of the sums of a slot without samples.
    """

    def __init__(self, columns: int, slots: int = WINDOW_SLOTS, empty: float = 0.0) -> None:
        self._slots = slots
        self._columns = columns
        self._empty = empty
        self._last: int | None = None
        self._kept = np.full((slots, columns), empty)

    def feed(self, index: NDArray[np.int64], sums: Array) -> Array:
        """Return the windows that end with each of these slots.

        Parameters
        ----------
        index, sums
            Increasing slot numbers, shape (k,), and their sums, shape (k, m); omitted slots are empty.

        Returns
        -------
        NDArray
            Shape (k, S, m), the oldest slot first.
        """
        last = int(index[0]) - 1 if self._last is None else self._last
        steps = index - np.concatenate([[last], index[:-1]])
        ahead = np.minimum(steps, self._slots + 1).cumsum()  # a jump of the clock must not allocate memory
        dense = np.full((self._slots + int(ahead[-1]), self._columns), self._empty)
        dense[: self._slots] = self._kept
        dense[self._slots + ahead - 1] = sums
        self._kept = dense[-self._slots :]
        self._last = int(index[-1])
        rows = ahead[:, None] + np.arange(self._slots)
        windows: Array = dense[rows]
        return windows
