"""Least squares on sums: what follows from any sum of slots.

Coefficients have priors, which the actuator's data sheet gives: a term that a window does not show
stays at what is known of it, instead of taking its noise to the others.

The standard error of a coefficient is the larger of two: the delete-one jackknife over the window's
slots (R. G. Miller, "The jackknife: a review", Biometrika 61, 1974), which takes the correlation of
the residuals within a slot as it is, and that of independent residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mavhums.health.normal_equations import solve

__all__ = ["Fit", "Prior"]

_LEAST = 1e-8
_MIN_SLOTS = 4

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known of p coefficients: means and standard deviations, infinite where nothing is."""

    mean: Array
    deviation: Array


class Fit:
    """The coefficients of windows, each of S slots.

    Parameters
    ----------
    sums
        Of :func:`~mavhums.health.normal_equations.sums_of_slots`, shape (W, S, m).
    prior
        Of the p coefficients.
    """

    def __init__(self, sums: Array, prior: Prior) -> None:
        self._sums = sums
        self._prior = prior

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

    def attenuation(self, term: int) -> Array:
        """How far errors in a term can have pulled the coefficients, shape (W, p).

        What is true of its own is at most 1/r² of what is seen, r being the term's partial correlation with
        the left side; the others shift with it.
        """
        coefficients, _, variance, inverse = self._solution
        own = np.maximum(np.abs(coefficients[:, term]), _LEAST)
        shift: Array = (self.count * variance / own)[:, None] * np.abs(inverse[:, :, term])
        return shift

    @cached_property
    def _solution(self) -> tuple[Array, Array, Array, Array]:
        return solve(self._sums, self._prior.mean, self._prior.deviation)
