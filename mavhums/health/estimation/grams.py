"""Gram matrices: sums of products of some columns, the last of which is the left side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from mavhums.core.arrays import Array, Integers

_NOTHING = 1e-10
_ROUNDING = 1e-11
_MOST = 16


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
