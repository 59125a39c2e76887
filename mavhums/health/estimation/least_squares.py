"""Normal equations of least squares: compiled sums over samples, solutions, and Gram matrices of a flight.

A row of sums contains, for p terms, the number of samples, y², X·y and the upper triangle of X·Xᵀ row by row:
m = 2 + p + p·(p + 1)/2 numbers.

A Gram matrix holds the sums of products of some columns, the last of which is the left side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import sqrt
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Array1, Array2, Array3, Flags, Flags1, Integers, Integers1
from mavhums.core.kernels import kernel, subroutine
from mavhums.core.statistics import uniform_deviation
from mavhums.health.estimation.thresholds import LEAST_PARTS, WINDOW_S

_WEAK = 1e-8  # share of a sum of squares: keeps a matrix regular, far below the weight of any sample
_LEAST = 1e-8  # coefficient that counts as zero, so that nothing is divided by it


def row_length(p: int) -> int:
    """Return m, the length of a row of sums for p terms.

    Examples
    --------
    >>> row_length(3)
    11
    """
    return 2 + p + p * (p + 1) // 2


@kernel
def sums_of_slots(X: Array2, y: Array1, usable: Flags1, start: Integers1) -> Array:
    """Return the sums of each slot's usable samples, shape (k, m).

    Parameters
    ----------
    X, y
        Terms, shape (n, p), and the left side, shape (n,).
    usable
        Mask of the samples that count, shape (n,); the others may have any value.
    start
        Index of the first sample of each slot, shape (k,); the last slot ends with the samples.
    """
    n, p = X.shape
    out = np.zeros((len(start), 2 + p + p * (p + 1) // 2))
    for slot in range(len(start)):
        end = start[slot + 1] if slot + 1 < len(start) else n
        row = out[slot]
        for i in range(start[slot], end):
            if not usable[i]:
                continue
            row[0] += 1.0
            row[1] += y[i] * y[i]
            column = 2 + p
            for j in range(p):
                row[2 + j] += X[i, j] * y[i]
                for k in range(j, p):
                    row[column] += X[i, j] * X[i, k]
                    column += 1
    return out


@kernel
def solve(sums: Array3, mean: Array1, deviation: Array1) -> tuple[Array, Array, Array, Array]:
    """Fit windows, each of S slots.

    Parameters
    ----------
    sums
        Shape (W, S, m).
    mean, deviation
        Prior of the coefficients, shape (p,); the deviation of an unknown one is infinite.

    Returns
    -------
    tuple of NDArray
        Coefficients, shape (W, p); their standard errors, shape (W, p); the variance of a residual,
        shape (W,); the inverse of the normal matrix with the prior, shape (W, p, p).
    """
    W, S, m = sums.shape
    p = len(mean)
    coefficients, errors = np.empty((W, p)), np.empty((W, p))
    variance, inverse = np.empty(W), np.empty((W, p, p))
    total, rest, weights = np.empty(m), np.empty(m), np.zeros(p)
    factor, without, zero = np.empty((p, p)), np.empty(p), np.zeros(p)
    for w in range(W):
        total[:] = 0.0
        filled = 0
        for s in range(S):
            total += sums[w, s]
            filled += sums[w, s, 0] > 0.0
        weights[:] = 0.0
        _posterior(total, weights, zero, factor, without)
        explained = 0.0
        for j in range(p):
            explained += without[j] * total[2 + j]
        variance[w] = max((total[1] - explained) / max(total[0] - p, 1.0), 1e-12)
        for j in range(p):
            # A prior counts as samples do: by the residuals' variance over its own.
            weights[j] = variance[w] / (deviation[j] * deviation[j])
        _posterior(total, weights, mean, factor, coefficients[w])
        inverse[w] = 0.0
        for j in range(p):
            inverse[w, j, j] = 1.0
            _substitute(factor, inverse[w, j])
        errors[w] = 0.0
        for s in range(S):
            if sums[w, s, 0] > 0.0 and filled > 1:
                rest[:] = total - sums[w, s]
                _posterior(rest, weights, mean, factor, without)
                for j in range(p):
                    errors[w, j] += (without[j] - coefficients[w, j]) ** 2
        for j in range(p):
            # Never less than the error for independent residuals: few slots can agree by chance.
            jackknife = errors[w, j] * (filled - 1) / max(filled, 1)
            errors[w, j] = sqrt(max(jackknife, variance[w] * inverse[w, j, j]))
    return coefficients, errors, variance, inverse


@subroutine
def _posterior(total: Array, weights: Array, mean: Array, factor: Array, out: Array) -> None:
    """Write the coefficients of a row of sums, each drawn to its prior mean by its weight."""
    p = len(mean)
    column = 2 + p
    for j in range(p):
        for k in range(j, p):
            factor[k, j] = total[column]
            column += 1
        square = factor[j, j]
        # A term that no sample shows would make the matrix singular.
        ridge = weights[j] + _WEAK * (square + (1.0 if weights[j] == 0.0 else 0.0))
        factor[j, j] += ridge
        out[j] = total[2 + j] + ridge * mean[j]
    for j in range(p):
        for k in range(j):
            factor[j, j] -= factor[j, k] * factor[j, k]
        factor[j, j] = sqrt(factor[j, j])
        for i in range(j + 1, p):
            for k in range(j):
                factor[i, j] -= factor[i, k] * factor[j, k]
            factor[i, j] /= factor[j, j]
    _substitute(factor, out)


@subroutine
def _substitute(factor: Array, out: Array) -> None:
    """Replace one right side by its solution, given a matrix's lower Cholesky factor."""
    p = len(out)
    for j in range(p):
        for k in range(j):
            out[j] -= factor[j, k] * out[k]
        out[j] /= factor[j, j]
    for j in range(p - 1, -1, -1):
        for k in range(j + 1, p):
            out[j] -= factor[k, j] * out[k]
        out[j] /= factor[j, j]


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Prior of p coefficients: means and standard deviations, infinite for unknown ones."""

    mean: Array
    deviation: Array


class Coefficient(NamedTuple):
    """One coefficient in W windows, and its standard error; shapes (W,)."""

    value: Array
    std_error: Array


class Fit:
    """Fitted coefficients of W windows of S slots each.

    Parameters
    ----------
    sums
        Of :func:`~mavhums.health.estimation.least_squares.sums_of_slots`, shape (W, S, m).
    prior
        Of the p coefficients.
    terms
        Names of the p coefficients.
    """

    def __init__(self, sums: Array, prior: Prior, terms: Sequence[str]) -> None:
        self._sums = sums
        self._prior = prior
        self._places = {term: place for place, term in enumerate(terms)}

    def __getitem__(self, term: str) -> Coefficient:
        """Return the coefficient of a term and its standard error."""
        place = self._places[term]
        return Coefficient(self.coefficients[:, place], self.errors[:, place])

    @cached_property
    def count(self) -> Array:
        """Number of samples in each window, shape (W,)."""
        return np.asarray(self._sums[:, :, 0].sum(axis=1))

    @cached_property
    def filled(self) -> Integers:
        """Number of slots with samples in each window, shape (W,)."""
        return np.asarray(np.count_nonzero(self._sums[:, :, 0], axis=1))

    @property
    def spread(self) -> Flags:
        """Whether a window has enough of them for meaningful errors, shape (W,)."""
        return self.filled >= LEAST_PARTS

    @property
    def freedom(self) -> Array:
        """Degrees of freedom of the errors, shape (W,)."""
        return np.asarray(np.maximum(self.filled - 1.0, 1.0))

    @property
    def coefficients(self) -> Array:
        """The coefficients, shape (W, p)."""
        return self._solution[0]

    @property
    def errors(self) -> Array:
        """Standard errors of the coefficients, shape (W, p)."""
        return self._solution[1]

    @property
    def variance(self) -> Array:
        """Variance of a residual, shape (W,)."""
        return self._solution[2]

    def given(self, term: str, other: str, value: float) -> Array:
        """Return the coefficient of a term if that of another were this value, shape (W,)."""
        coefficients, _, _, inverse = self._solution
        place, at = self._places[term], self._places[other]
        slope = inverse[:, place, at] / inverse[:, at, at]
        return np.asarray(coefficients[:, place] + slope * (value - coefficients[:, at]))

    def both_ways(self, term: str, constant: str) -> Integers:
        """Return the number of slots in which a term of ±1 had its rarer sign, shape (W,).

        ``constant`` is the term that is 1 in every sample.
        """
        p = self._prior.mean.size
        first, last = sorted((self._places[term], self._places[constant]))
        # The entry (first, last) of the upper triangle, which is stored row by row.
        balance = self._sums[:, :, 2 + p + first * p - first * (first - 1) // 2 + last - first]
        count = self._sums[:, :, 0]
        slots = [np.count_nonzero(count + signed > 0.5, axis=1) for signed in (balance, -balance)]
        return np.asarray(np.minimum(*slots))

    def corrected(self, term: str, *, noisy: str, healthy: float = 0.0) -> Coefficient:
        """Return the coefficient of a term, and a standard error that allows for noise in a ``noisy`` term.

        Noise in a term biases its coefficient towards zero, and the others with it. The true coefficient
        lies between the estimate and 1/r² times the estimate, where r is the term's partial correlation
        with the left side. The midpoint is returned, with an error that covers both ends.

        The noise is at most that which explains all residuals by the noisy term's coefficient, or by the
        ``healthy`` one if that is larger: a fault that takes the coefficient away adds no noise to the term.
        """
        coefficients, errors, variance, inverse = self._solution
        noise, place = self._places[noisy], self._places[term]
        # The sign is kept, and a coefficient near zero must not divide.
        own = np.copysign(np.maximum(np.abs(coefficients[:, noise]), _LEAST), coefficients[:, noise])
        most = self.count * variance * own / np.maximum(np.abs(own), healthy) ** 2 * inverse[:, place, noise]
        std_error = np.hypot(errors[:, place], uniform_deviation(most))
        return Coefficient(coefficients[:, place] + most / 2, std_error)

    @cached_property
    def _solution(self) -> tuple[Array, Array, Array, Array]:
        return solve(np.ascontiguousarray(self._sums), self._prior.mean, self._prior.deviation)


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
        gram[k, :] = gram[:, k] = 0.0
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

    Examples
    --------
    >>> groups = Groups(1, np.asarray)
    >>> groups.feed(np.arange(0, 400, 10), np.full((40, row_length(1)), 10.0))
    >>> [count for count, _ in groups.parts()]
    [40, 40, 40, 40, 40, 40, 40, 40, 40, 30, 10]
    """

    def __init__(self, terms: int, in_window: Callable[[Array], Array]) -> None:
        self._terms, self._in_window = terms, in_window
        self._row = np.zeros(row_length(terms))
        self._window: int | None = None
        self._closed: list[tuple[int, Array]] = []
        self._of_part, self._in_part = 1, 0

    def feed(self, index: Integers, rows: Array) -> None:
        """Add slots by their numbers, shape (k,), and their rows of sums, shape (k, m)."""
        for row, window in zip(rows, (index // WINDOW_S).tolist(), strict=True):
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
        return one[0] + other[0], one[1] + other[1]
