"""Wear over flights: a straight line through one indicator.

A flight's value is the sum of the line, an effect of the flight (temperature, load) and the flight's
measurement error. Paule and Mandel's equation estimates the variance between flights; least squares
weighted with both variances estimates the line. Its intervals are those of Knapp and Hartung, Student's t
with n − 2 degrees of freedom; if neighbouring flights are correlated, their lag-one autocorrelation ρ
increases the variance by (1 + ρ)/(1 − ρ).

One flight in ten, and at least one, may be an outlier from the line of the others, by the t-test of its
deleted residual with Bonferroni's correction; it is excluded and reported.

The line describes; :mod:`mavhums.health.decision.growth` decides whether an indicator grows.

References
----------
R. C. Paule and J. Mandel (1982), Journal of Research of the National Bureau of Standards 87:377.
G. Knapp and J. Hartung (2003), Statistics in Medicine 22:2693.
G. V. Bayley and J. M. Hammersley (1946), Supplement to the Journal of the Royal Statistical Society 8:184.
N. R. Draper and H. Smith (1998), Applied Regression Analysis, 3rd ed., sections 3.2 and 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import CENTRAL_95, t_probability, t_quantile
from mavhums.health.decision.thresholds import (
    FLIGHTS_PER_OUTLIER,
    MOST_AUTOCORRELATION,
    MOST_FLIGHT_TAIL,
    TREND_FLIGHTS,
)
from mavhums.health.estimation.random_effects import variance_between, weighted
from mavhums.health.estimation.thresholds import LEAST_ERROR_SHARE
from mavhums.results.standing import Interval


@dataclass(frozen=True, slots=True)
class Trend:
    """A straight line through the flights of one actuator.

    Attributes
    ----------
    level
        The line at the last flight.
    per_flight
        Slope of the line per flight.
    between
        Standard deviation between flights, without measurement errors.
    flights
        Number of flights that the line was fitted to.
    left_out
        Indices of the outliers, in time order.
    """

    level: Interval
    per_flight: Interval
    between: float
    flights: int
    left_out: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _TrendLine:
    """Level at the last flight and slope, and their covariance."""

    level: float
    slope: float
    covariance: Array
    between: float
    deleted: Array
    freedom: int


def fit_trend(numbers: Array, values: Array, errors: Array) -> Trend | None:
    """Fit a line to an indicator over flights; None for fewer than ``MIN_FLIGHTS``.

    Parameters
    ----------
    numbers
        Flight numbers, increasing, shape (n,); gaps are flights without a judgement.
    values
        Values of the indicator, shape (n,), in any unit.
    errors
        Standard errors of measurement, shape (n,), in the same unit, without errors that all flights
        share.

    Examples
    --------
    >>> flights = np.arange(40.0)
    >>> noise = 0.004 * np.sin(np.arange(40) * 2.4)
    >>> trend = fit_trend(flights, 0.225 + 0.005 * flights + noise, np.full(40, 0.002))
    >>> round(trend.per_flight.estimate, 3)
    0.005
    """
    if len(values) < TREND_FLIGHTS:
        return None
    errors = np.maximum(errors, max(LEAST_ERROR_SHARE * errors.max(), 1e-9 * np.abs(values).max(), 1e-12))
    kept, line = _without_outliers(numbers, values, errors)
    t = t_quantile(line.freedom, CENTRAL_95)
    return Trend(
        level=Interval.around(line.level, t * sqrt(line.covariance[0, 0])),
        per_flight=Interval.around(line.slope, t * sqrt(line.covariance[1, 1])),
        between=line.between,
        flights=int(np.count_nonzero(kept)),
        left_out=tuple(int(place) for place in np.flatnonzero(~kept)),
    )


def _without_outliers(numbers: Array, values: Array, errors: Array) -> tuple[Flags, _TrendLine]:
    """Exclude outliers: repeatedly the flight farthest from the line of the others, up to one in ten."""
    kept = np.ones(len(values), dtype=np.bool_)
    line = _fit(numbers, values, errors, numbers[-1])
    for _ in range(max(1, len(values) // FLIGHTS_PER_OUTLIER)):
        n = len(line.deleted)
        worst = int(np.argmax(np.abs(line.deleted)))
        chance = 2 * n * t_probability(n - 3, -abs(line.deleted[worst]))
        if chance > MOST_FLIGHT_TAIL:
            break
        kept[np.flatnonzero(kept)[worst]] = False
        line = _fit(numbers[kept], values[kept], errors[kept], numbers[-1])
    return kept, line


def _fit(numbers: Array, values: Array, errors: Array, last: float) -> _TrendLine:
    design = np.column_stack([np.ones_like(numbers), numbers - last])
    between = variance_between(design, values, errors)
    weights = 1 / (errors**2 + between)
    coefficients, residuals, inverse = weighted(design, values, weights)
    freedom = len(values) - 2
    scale = float(residuals @ residuals) / freedom
    leverage = weights * np.einsum("ij,jk,ik->i", design, inverse, design)
    free = np.clip(1 - leverage, 1e-9, None)
    others = (scale * freedom - residuals**2 / free) / (freedom - 1)
    deleted = residuals / np.sqrt(free * np.maximum(others, 1e-12 * scale + 1e-24))
    return _TrendLine(
        level=float(coefficients[0]),
        slope=float(coefficients[1]),
        covariance=widening(residuals) * scale * inverse,
        between=sqrt(between),
        deleted=deleted,
        freedom=freedom,
    )


def widening(residuals: Array) -> float:
    """Return the variance inflation from correlated neighbouring flights; 1 if they are uncorrelated."""
    total = float(residuals @ residuals)
    alike = float(residuals[:-1] @ residuals[1:]) / total if total > 0 else 0.0
    # Neighbours that differ more than by chance do not make the line more certain.
    alike = min(max(alike, 0.0), MOST_AUTOCORRELATION)
    return (1 + alike) / (1 - alike)
