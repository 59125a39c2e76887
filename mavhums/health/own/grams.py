"""Gram matrices: sums of products of some columns, the last of which is the left side."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["eliminated", "full", "packed", "unpacked"]

_NOTHING = 1e-10
_ROUNDING = 1e-11

Array = NDArray[np.float64]


def full(row: Array, p: int) -> Array:
    """Return the Gram matrix, shape (p + 1, p + 1), of a row of :mod:`~mavhums.health.normal_equations`."""
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
def _upper(size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    rows, columns = np.triu_indices(size)
    return rows, columns
