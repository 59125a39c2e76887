"""Gram matrices: sums of products of some columns, the last of which is the left side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.health.estimation.least_squares import row_length
from mavhums.health.estimation.thresholds import WINDOW_SLOTS

_NOTHING = 1e-10  # sum of squares: a column below it is all zeros
_ROUNDING = 1e-11  # share of its sum of squares that rounding leaves of a column that others explain
_MOST = 16  # parts of a flight, at least 8 once it is long: bounds the size of a record


def full(row: Array, p: int) -> Array:
    """Return the Gram matrix, shape (p + 1, p + 1), of a row of :mod:`~.least_squares`."""
    gram = np.zeros((p + 1, p + 1))
    gram[np.triu_indices(p)] = row[2 + p :]
    gram[:p, p] = row[2 : 2 + p]
    gram[p, p] = row[1]
    return np.triu(gram) + np.triu(gram, 1).T


def eliminated(gram: Array, columns: Sequence[int]) -> Array:
    """Return the Gram matrix of the residuals after a regression on these columns (Schur complement).

    Examples
    --------
    >>> x = np.array([[1.0, 1.0, 5.0], [1.0, 2.0, 7.0], [1.0, 3.0, 9.0]])
    >>> left = eliminated(x.T @ x, [0])  # a constant: the others lose their means
    >>> float(left[1, 2] / left[1, 1])
    2.0
    """
    gram, least = gram.copy(), np.maximum(_ROUNDING * np.diag(gram), _NOTHING)
    for k in columns:
        pivot = gram[k, k]
        # A column that others explain leaves rounding errors, not information.
        if pivot > least[k]:
            gram -= np.outer(gram[:, k], gram[k]) / pivot
        gram[k, :] = 0.0
        gram[:, k] = 0.0
    return gram


def packed(gram: Array) -> list[float]:
    """Return the upper triangle, row by row, in nine significant digits."""
    return [float(f"{number:.9g}") for number in gram[_upper(len(gram))].tolist()]


def unpacked(numbers: Sequence[float], size: int) -> Array:
    """Return the matrix of an upper triangle."""
    rows, columns = _upper(size)
    gram = np.empty((size, size))
    gram[rows, columns] = gram[columns, rows] = numbers
    return gram


@lru_cache
def _upper(size: int) -> tuple[Integers, Integers]:
    rows, columns = np.triu_indices(size)
    return rows, columns


class Groups:
    """Collects the sums of a flight: of slots in windows, of windows in up to sixteen parts of equal length.

    Parameters
    ----------
    terms
        Number of terms p of the rows of :mod:`~.least_squares`.
    in_window
        Returns the sums of a window that are kept, of its whole Gram matrix.
    joined
        Applied to the sums of a window before they are added to another's.

    Examples
    --------
    >>> groups = Groups(1, np.asarray)
    >>> groups.feed(np.arange(0, 400, 10), np.full((40, row_length(1)), 10.0))
    >>> [count for count, _ in groups.parts()]
    [40, 40, 40, 40, 40, 40, 40, 40, 40, 30, 10]
    """

    def __init__(
        self, terms: int, in_window: Callable[[Array], Array], joined: Callable[[Array], Array] = np.asarray
    ) -> None:
        self._terms, self._in_window, self._joined = terms, in_window, joined
        self._row = np.zeros(row_length(terms))
        self._window: int | None = None
        self._closed: list[tuple[int, Array]] = []
        self._of_part, self._in_part = 1, 0

    def feed(self, index: Integers, rows: Array) -> None:
        """Add slots by their numbers, shape (k,), and their rows of sums, shape (k, m)."""
        for row, window in zip(rows, (index // WINDOW_SLOTS).tolist(), strict=True):
            if window != self._window:
                for part in self._open():
                    self._add(part)
                self._row[:] = 0.0
                self._window = window
            self._row += row

    def parts(self) -> list[tuple[int, Array]]:
        """Return number of samples and sums of each part, in time order; the open window comes last."""
        return [*self._closed, *self._open()]

    def _open(self) -> list[tuple[int, Array]]:
        if self._row[0] < 1.0:
            return []
        return [(int(self._row[0]), self._in_window(full(self._row, self._terms)))]

    def _add(self, window: tuple[int, Array]) -> None:
        if self._in_part == self._of_part:
            self._in_part = 0
            if len(self._closed) == _MOST:
                # Full: neighbours are joined, so that memory stays the same for any length of flight.
                pairs = zip(self._closed[::2], self._closed[1::2], strict=True)
                self._closed = [self._sum(first, second) for first, second in pairs]
                self._of_part *= 2
        if self._in_part == 0:
            self._closed.append(window)
        else:
            self._closed[-1] = self._sum(self._closed[-1], window)
        self._in_part += 1

    def _sum(self, one: tuple[int, Array], other: tuple[int, Array]) -> tuple[int, Array]:
        return one[0] + other[0], self._joined(one[1]) + self._joined(other[1])
