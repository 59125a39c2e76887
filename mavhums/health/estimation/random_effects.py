"""Random-effects least squares for flights that differ by more than their measurement errors.

References
----------
R. C. Paule and J. Mandel (1982), Journal of Research of the National Bureau of Standards 87:377.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.estimation.thresholds import NATURAL_SCATTER_FREEDOM, NATURAL_SCATTER_SHARE


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Flights as a random sample: a least-squares fit of their known differences.

    Attributes
    ----------
    coefficients, covariance
        Coefficients of the design's columns, and their covariance, shapes (p,) and (p, p).
    between
        Standard deviation of flights' true values about the fit.
    freedom
        Degrees of freedom of a new flight's deviation.
    """

    coefficients: Array
    covariance: Array
    between: float
    freedom: float

    def variance_at(self, row: Array) -> float:
        """Return the variance of a new flight's true value about its expectation."""
        return self.between**2 + float(row @ self.covariance @ row)


def population(
    design: Array, values: Array, errors: Array, natural_scatter: float = NATURAL_SCATTER_SHARE
) -> Population:
    """Fit flights; a lower bound prevents a few flights from showing too little scatter by chance.

    The scatter between them is not less than what Paule and Mandel's equation gives, and not less than
    that pooled with the natural scatter, 5 % of the mean by default, which counts as much as nine degrees
    of freedom of the flights' own.

    Parameters
    ----------
    design, values, errors
        Shapes (n, p), (n,) and (n,), the first column of the design being 1; n > p.
    natural_scatter
        Share of the mean by which healthy flights scatter.

    Examples
    --------
    >>> flights = population(np.ones((10, 1)), np.full(10, 2.0), np.full(10, 0.01))
    >>> round(flights.between, 3), round(flights.freedom)
    (0.071, 18)
    """
    p = design.shape[1]
    own = variance_between(design, values, errors)
    first = weighted(design, values, 1.0 / (errors**2 + own + 1e-300))[0]
    freedom = len(values) - p
    natural = (natural_scatter * float(first[0])) ** 2
    pooled = (NATURAL_SCATTER_FREEDOM * natural + freedom * own) / (NATURAL_SCATTER_FREEDOM + freedom)
    between = max(own, pooled)
    weights = 1.0 / (errors**2 + between)
    coefficients, residuals, inverse = weighted(design, values, weights)
    scale = max(float(residuals @ residuals) / freedom, 1.0)
    effective = float(weights.sum() ** 2 / (weights**2).sum()) - p
    trusted = NATURAL_SCATTER_FREEDOM if pooled > own else 0.0
    return Population(coefficients, scale * inverse, float(np.sqrt(between)), max(effective, 1.0) + trusted)


def weighted(design: Array, values: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Return the coefficients, the weighted residuals and the inverse of the normal matrix.

    Parameters
    ----------
    design, values, weights
        Shapes (n, p), (n,) and (n,); weights are inverse variances.
    """
    root = np.sqrt(weights)
    scaled = design * root[:, None]
    inverse = np.linalg.inv(scaled.T @ scaled).astype(np.float64)
    coefficients = np.linalg.lstsq(scaled, values * root)[0].astype(np.float64)
    return coefficients, root * (values - design @ coefficients), inverse


def variance_between(design: Array, values: Array, errors: Array) -> float:
    """Return the variance between flights for which the weighted squares equal their expectation.

    Examples
    --------
    >>> values = np.array([0.20, 0.23, 0.26])
    >>> variance = variance_between(np.ones((3, 1)), values, np.full(3, 0.01))
    >>> round(variance, 6) == round(float(np.var(values, ddof=1)) - 0.01**2, 6)
    True
    """
    from scipy.optimize import brentq  # a quarter of a second, spent only when there are earlier flights

    freedom = len(values) - design.shape[1]

    def excess(variance: float) -> float:
        residuals = weighted(design, values, 1 / (errors**2 + variance))[1]
        return float(residuals @ residuals - freedom)

    if excess(0.0) <= 0:
        return 0.0
    plain = weighted(design, values, np.ones_like(values))[1]
    enough = 2 * float(plain @ plain) / freedom
    return float(brentq(excess, 0.0, enough, xtol=1e-9 * enough, rtol=1e-6))
