"""Random-effects least squares for flights that differ by more than their measurement errors.

References
----------
R. C. Paule and J. Mandel (1982), Journal of Research of the National Bureau of Standards 87:377.
G. K. Smyth (2004), Statistical Applications in Genetics and Molecular Biology 3(1):3.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.estimation.thresholds import BASELINE_FLIGHTS, NATURAL_SCATTER_SHARE, STATED_ERROR_FREEDOM

_MOST_STEPS = 50


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
    # The natural scatter weighs as much as a baseline's own.
    usual = BASELINE_FLIGHTS - 1.0
    pooled = (usual * natural + freedom * own) / (usual + freedom)
    # A few flights may agree by chance, but real actuators differ from day to day.
    between = max(own, pooled)
    weights = 1.0 / (errors**2 + between)
    coefficients, residuals, inverse = weighted(design, values, weights)
    # Never less than the stated errors.
    scale = max(float(residuals @ residuals) / freedom, 1.0)
    effective = float(weights.sum() ** 2 / (weights**2).sum()) - p
    # Where the prior decides, it brings its own certainty.
    trusted = usual if pooled > own else 0.0
    return Population(coefficients, scale * inverse, float(np.sqrt(between)), max(effective, 1.0) + trusted)


@dataclass(frozen=True, slots=True)
class CommonError:
    """What the reference flights know of the error of one flight (Smyth's moderated variance).

    The jackknife over the few parts of a flight is itself uncertain, to a quarter for ten parts.

    Attributes
    ----------
    variance
        Expected variance of a flight with one sample of information.
    freedom
        Degrees of freedom that it is worth: the more, the more alike the flights' errors are.
    """

    variance: float
    freedom: float

    @classmethod
    def of(cls, variances: Array, freedom: Array) -> CommonError:
        """Learn from flights: their variances with one sample of information, and these' degrees of freedom.

        Examples
        --------
        >>> alike = CommonError.of(np.full(20, 0.04), np.full(20, 10.0))
        >>> round(alike.variance, 3), alike.freedom
        (0.044, 200.0)
        """
        from scipy.optimize import brentq  # 0.4 s to import
        from scipy.special import digamma, polygamma

        logarithms = np.log(variances + 1e-300) - digamma(freedom / 2) + np.log(freedom / 2)
        true = float(logarithms.var(ddof=1) - polygamma(1, freedom / 2).mean())

        def unlike(worth: float) -> float:
            return float(polygamma(1, worth / 2)) - true

        # Together they are worth no more than all their parts, and a flight's own error always counts.
        least, worth = 1e-3, float(freedom.sum())
        if unlike(worth) < 0.0:
            worth = float(brentq(unlike, least, worth))
        mean = float(logarithms.mean() + digamma(worth / 2) - np.log(worth / 2))
        return cls(float(np.exp(mean)), worth)

    def with_own(self, variance: float, freedom: float, information: float) -> tuple[float, float]:
        """Return the variance of a flight with this jackknife, and its degrees of freedom.

        A larger one of its own counts in full: gusts that no flight before had must not pass for chance.
        The larger of the two is no underestimate, and keeps the degrees of freedom of both.
        """
        total = self.freedom + freedom
        moderated = (self.freedom * self.variance / information + freedom * variance) / total
        return max(variance, moderated), total


def scattering_share(design: Array, values: Array, errors: Array) -> tuple[float, float]:
    """Return the share of the flights' own variances that scatters between them, at most 1; its freedom.

    The jackknife over the parts of a flight counts all in which they differ. What recurs in each flight, for
    its motions recur, does not scatter between flights. That the stated errors are right counts for a
    little, so that a few flights that agree by chance do not show none.

    Examples
    --------
    >>> share, freedom = scattering_share(np.ones((20, 1)), np.full(20, 2.0), np.full(20, 0.1))
    >>> round(share, 3), freedom
    (0.095, 21.0)
    """
    residuals = weighted(design, values, 1.0 / (errors**2 + 1e-300))[1]
    freedom = len(values) - design.shape[1] + STATED_ERROR_FREEDOM
    return min((float(residuals @ residuals) + STATED_ERROR_FREEDOM) / freedom, 1.0), freedom


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
    coefficients = inverse @ (scaled.T @ (values * root))
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
    freedom, variance = len(values) - design.shape[1], 0.0
    for _ in range(_MOST_STEPS):
        weights = 1 / (errors**2 + variance)
        squares = weighted(design, values, weights)[1] ** 2
        total = float(squares.sum())
        # Newton's method on the reciprocal, which of equal errors is a straight line.
        step = total * (total / freedom - 1) / (float(weights @ squares) + 1e-300)
        if variance + step <= 0:
            return 0.0  # the errors alone explain the scatter
        variance += step
        if abs(step) < 1e-9 * variance:
            break
    return variance


def satterthwaite(first: float, first_freedom: float, second: float, second_freedom: float) -> float:
    """Return the degrees of freedom of a sum of two variances (F. E. Satterthwaite, 1946)."""
    return (first + second) ** 2 / (first**2 / first_freedom + second**2 / second_freedom)


class RunningVariance:
    """Count, mean and variance of numbers that come one by one (B. P. Welford, Technometrics 4, 1962).

    Examples
    --------
    >>> variance = RunningVariance()
    >>> for number in (1.0, 2.0, 3.0):
    ...     variance.add(number)
    >>> variance.count, variance.deviation
    (3, 1.0)
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = self._squares = self._weight = 0.0

    def add(self, number: float, weight: float = 1.0) -> None:
        """Add a number, with its inverse variance as weight where that is known."""
        self.count += 1
        self._weight += weight
        before = number - self.mean
        self.mean += before * weight / self._weight
        self._squares += before * weight * (number - self.mean)

    @property
    def mean_error(self) -> float:
        """Standard error of the mean of weighted numbers: by their scatter if their errors promise less."""
        return sqrt(max(self.variance, 1.0) / self._weight)

    @property
    def variance(self) -> float:
        """Variance; 0 for fewer than two numbers."""
        return self._squares / (self.count - 1) if self.count > 1 else 0.0

    @property
    def deviation(self) -> float | None:
        """Standard deviation; None for fewer than two numbers."""
        return sqrt(self.variance) if self.count > 1 else None
