"""Least squares on sums of slots, with priors and jackknife errors.

Coefficients have priors from the actuator's data sheet: a coefficient without evidence in a window
stays at its prior, and its noise does not affect the others.

The standard error of a coefficient is the larger of two: the delete-one jackknife over the window's
slots (R. G. Miller, "The jackknife: a review", Biometrika 61, 1974), which allows for correlated
residuals within a slot, and the standard error for independent residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.health.normal_equations import solve

__all__ = ["Coefficient", "Fit", "Prior"]

_LEAST = 1e-8
_MIN_SLOTS = 4

Array = NDArray[np.float64]


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
        Of :func:`~mavhums.health.normal_equations.sums_of_slots`, shape (W, S, m).
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
        count: Array = self._sums[:, :, 0].sum(axis=1)
        return count

    @cached_property
    def filled(self) -> NDArray[np.int64]:
        """Number of slots with samples in each window, shape (W,)."""
        return np.asarray(np.count_nonzero(self._sums[:, :, 0], axis=1))

    @property
    def spread(self) -> NDArray[np.bool_]:
        """Whether a window has enough of them for meaningful errors, shape (W,)."""
        return self.filled >= _MIN_SLOTS

    @property
    def freedom(self) -> Array:
        """Degrees of freedom of the errors, shape (W,)."""
        freedom: Array = np.maximum(self.filled - 1.0, 1.0)
        return freedom

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

    def both_ways(self, term: str, constant: str) -> NDArray[np.int64]:
        """Return the number of slots in which a term of ±1 had its rarer sign, shape (W,).

        ``constant`` is the term that is 1 in every sample.
        """
        p = self._prior.mean.size
        first, last = sorted((self._places[term], self._places[constant]))
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
        own = np.copysign(np.maximum(np.abs(coefficients[:, noise]), _LEAST), coefficients[:, noise])
        most = self.count * variance * own / np.maximum(np.abs(own), healthy) ** 2 * inverse[:, place, noise]
        std_error = np.hypot(errors[:, place], most / np.sqrt(12.0))
        return Coefficient(coefficients[:, place] + most / 2, std_error)

    @cached_property
    def _solution(self) -> tuple[Array, Array, Array, Array]:
        return solve(np.ascontiguousarray(self._sums), self._prior.mean, self._prior.deviation)
