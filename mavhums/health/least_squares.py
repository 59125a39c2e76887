"""Least squares on sums: what a slot adds to the normal equations, and what follows from any sum of slots.

Coefficients have priors, which the actuator's data sheet gives: a term that a window does not show
stays at what is known of it, instead of taking its noise to the others.

The standard error of a coefficient is the larger of two: the delete-one jackknife over the window's
slots (R. G. Miller, "The jackknife: a review", Biometrika 61, 1974), which takes the correlation of
the residuals within a slot as it is, and that of independent residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Fit", "Prior", "moments"]

_WEAK = 1e-8
_MIN_SLOTS = 4

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known of p coefficients: means and standard deviations, infinite where nothing is."""

    mean: Array
    deviation: Array


def moments(X: Array, y: Array, usable: NDArray[np.bool_]) -> Array:
    """Return what each sample adds to the sums: 1, y², X·y and the upper triangle of X·Xᵀ.

    Parameters
    ----------
    X, y
        Terms, shape (n, p), and the left side, shape (n,).
    usable
        Samples that count; the others add zero, whatever they hold.

    Returns
    -------
    NDArray
        Shape (n, 2 + p + p·(p + 1)/2).
    """
    n, p = X.shape
    left, right, _ = _triangle(p)
    out = np.empty((n, 2 + p + left.size))
    out[:, 0] = 1.0
    out[:, 1] = y * y
    np.multiply(X, y[:, None], out=out[:, 2 : 2 + p])
    np.multiply(X[:, left], X[:, right], out=out[:, 2 + p :])
    out[~usable] = 0.0
    return out


class Fit:
    """The coefficients of windows, each of S slots.

    Parameters
    ----------
    sums
        Of :func:`moments` over each slot, shape (W, S, m).
    prior
        Of the p coefficients.

    Attributes
    ----------
    count
        Samples in each window, shape (W,).
    filled
        Slots with samples in each window, shape (W,).
    spread
        Whether they are enough for the errors to mean something, shape (W,).
    freedom
        Degrees of freedom of the errors, shape (W,).
    """

    def __init__(self, sums: Array, prior: Prior) -> None:
        self._sums = sums
        self._prior = prior
        self._total: Array = sums.sum(axis=1)
        self.count: Array = self._total[:, 0]
        self.filled: NDArray[np.int64] = np.count_nonzero(sums[:, :, 0], axis=1)
        self.spread: NDArray[np.bool_] = self.filled >= _MIN_SLOTS
        self.freedom: Array = np.maximum(self.filled - 1, 1).astype(np.float64)

    @cached_property
    def coefficients(self) -> Array:
        """Shape (W, p)."""
        ridge = self._ridge(self._total, self._weights)
        right = self._right(self._total) + ridge * self._prior.mean
        coefficients: Array = np.matvec(self._inverse, right)
        return coefficients

    @cached_property
    def variance(self) -> Array:
        """Of a residual, shape (W,)."""
        right = self._right(self._total)
        explained = np.sum(_solve(self._matrix(self._total), right) * right, axis=1)
        freedom = np.maximum(self.count - self._prior.mean.size, 1.0)
        variance: Array = np.maximum((self._total[:, 1] - explained) / freedom, 1e-12)
        return variance

    @cached_property
    def errors(self) -> Array:
        """Standard errors of the coefficients, shape (W, p)."""
        scatter = np.sum((self.without - self.coefficients[:, None]) ** 2, axis=1)
        slots = np.maximum(self.filled, 1)[:, None]
        error: Array = np.maximum(np.sqrt((slots - 1) / slots * scatter), self._independent)
        return error

    def attenuation(self, term: int) -> Array:
        """How far errors in a term can have pulled the coefficients, shape (W, p).

        What is true of its own is at most 1/r² of what is seen, r being the term's partial correlation with
        the left side; the others shift with it.
        """
        own, inverse = self.coefficients[:, term], self._inverse
        pulled = self.count * self.variance * inverse[:, term, term] / np.maximum(np.abs(own), _WEAK)
        shift: Array = np.abs(pulled[:, None] * inverse[:, :, term] / inverse[:, term, term, None])
        return shift

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self._matrix(self._total, self._weights)), dtype=np.float64)

    @cached_property
    def _independent(self) -> Array:
        """Standard errors if all residuals were independent, shape (W, p)."""
        error: Array = np.sqrt(self.variance[:, None] * np.diagonal(self._inverse, axis1=1, axis2=2))
        return error

    @cached_property
    def without(self) -> Array:
        """The coefficients with each slot left out, shape (W, S, p)."""
        W, S, m = self._sums.shape
        left = (self._total[:, None] - self._sums).reshape(W * S, m)
        weights = np.repeat(self._weights, S, axis=0)
        right = self._right(left) + self._ridge(left, weights) * self._prior.mean
        solved = _solve(self._matrix(left, weights), right)
        return solved.reshape(W, S, -1)

    @cached_property
    def _weights(self) -> Array:
        """What the prior adds to the normal matrix's diagonal, shape (W, p)."""
        weights: Array = self.variance[:, None] / self._prior.deviation**2
        return weights

    def _right(self, sums: Array) -> Array:
        return sums[:, 2 : 2 + self._prior.mean.size]

    def _matrix(self, sums: Array, weights: Array | float = 0.0) -> Array:
        """Return the normal matrices, regular even where a term never varies."""
        p = self._prior.mean.size
        matrix: Array = sums[:, 2 + p + _triangle(p).square].reshape(-1, p, p)
        diagonal = np.arange(p)
        matrix[:, diagonal, diagonal] += self._ridge(sums, weights)
        return matrix

    def _ridge(self, sums: Array, weights: Array | float) -> Array:
        """Return what holds each term to its prior mean, shape (W, p): the prior, and hardly more."""
        p = self._prior.mean.size
        squares = sums[:, 2 + p + _triangle(p).square[:: p + 1]]
        ridge: Array = weights + _WEAK * (squares + np.equal(weights, 0.0))
        return ridge


class _Triangle(NamedTuple):
    """Rows and columns of the upper triangle, and where in it each element of the matrix lies."""

    left: NDArray[np.int64]
    right: NDArray[np.int64]
    square: NDArray[np.int64]


@cache
def _triangle(p: int) -> _Triangle:
    left, right = np.triu_indices(p)
    square = np.empty((p, p), dtype=np.int64)
    square[left, right] = square[right, left] = np.arange(left.size)
    return _Triangle(left, right, square.ravel())


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0], dtype=np.float64)
