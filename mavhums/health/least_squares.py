"""Least squares on sums: what follows from any sum of slots.

Coefficients have priors, which the actuator's data sheet gives: a term that a window does not show
stays at what is known of it, instead of taking its noise to the others.

The standard error of a coefficient is the larger of two: the delete-one jackknife over the window's
slots (R. G. Miller, "The jackknife: a review", Biometrika 61, 1974), which takes the correlation of
the residuals within a slot as it is, and that of independent residuals.
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
    """What is known of p coefficients: means and standard deviations, infinite where nothing is."""

    mean: Array
    deviation: Array


class Coefficient(NamedTuple):
    """One coefficient in W windows, and its standard error; shapes (W,)."""

    value: Array
    std_error: Array


class Fit:
    """The coefficients of windows, each of S slots.

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
        """Return the coefficient of a term, and its standard error."""
        place = self._places[term]
        return Coefficient(self.coefficients[:, place], self.errors[:, place])

    @cached_property
    def count(self) -> Array:
        """Samples in each window, shape (W,)."""
        count: Array = self._sums[:, :, 0].sum(axis=1)
        return count

    @cached_property
    def filled(self) -> NDArray[np.int64]:
        """Slots with samples in each window, shape (W,)."""
        return np.asarray(np.count_nonzero(self._sums[:, :, 0], axis=1))

    @property
    def spread(self) -> NDArray[np.bool_]:
        """Whether they are enough for the errors to mean something, shape (W,)."""
        return self.filled >= _MIN_SLOTS

    @property
    def freedom(self) -> Array:
        """Degrees of freedom of the errors, shape (W,)."""
        freedom: Array = np.maximum(self.filled - 1.0, 1.0)
        return freedom

    @property
    def coefficients(self) -> Array:
        """Shape (W, p)."""
        return self._solution[0]

    @property
    def errors(self) -> Array:
        """Standard errors of the coefficients, shape (W, p)."""
        return self._solution[1]

    @property
    def variance(self) -> Array:
        """Of a residual, shape (W,)."""
        return self._solution[2]

    def both_ways(self, term: str, constant: str) -> NDArray[np.int64]:
        """Return in how many slots a term of ±1 had its rarer sign, shape (W,).

        ``constant`` is the term that is 1 in every sample.
        """
        p = self._prior.mean.size
        first, last = sorted((self._places[term], self._places[constant]))
        balance = self._sums[:, :, 2 + p + first * p - first * (first - 1) // 2 + last - first]
        count = self._sums[:, :, 0]
        slots = [np.count_nonzero(count + signed > 0.5, axis=1) for signed in (balance, -balance)]
        return np.asarray(np.minimum(*slots))

    def corrected(self, term: str, *, noisy: str) -> Coefficient:
        """Return the coefficient of a term, and a standard error that allows for noise in a ``noisy`` term.

        Noise in a term pulls its coefficient towards zero, and the others with it: what is true of its own
        lies between what is seen and 1/r² of that, r being the term's partial correlation with the left
        side. The middle is returned, and errors that hold either end.
        """
        coefficients, errors, variance, inverse = self._solution
        noise, place = self._places[noisy], self._places[term]
        own = np.copysign(np.maximum(np.abs(coefficients[:, noise]), _LEAST), coefficients[:, noise])
        most = self.count * variance / own * inverse[:, place, noise]
        std_error = np.hypot(errors[:, place], most / np.sqrt(12.0))
        return Coefficient(coefficients[:, place] + most / 2, std_error)

    @cached_property
    def _solution(self) -> tuple[Array, Array, Array, Array]:
        return solve(np.ascontiguousarray(self._sums), self._prior.mean, self._prior.deviation)
