"""Wear over flights: a straight line through one indicator, and the flights left to its limit.

A flight's value is the sum of the line, an effect of the flight (temperature, load) and the flight's
measurement error. Paule and Mandel's equation estimates the variance between flights; least squares
weighted with both variances estimates the line. Its intervals are those of Knapp and Hartung, Student's t
with n − 2 degrees of freedom; if neighbouring flights are correlated, their lag-one autocorrelation ρ
increases the variance by (1 + ρ)/(1 − ρ). The number of flights left is an inverse regression: Fieller's
interval of the line's intersection with the limit, which is bounded because the slope must be significant.

One flight in ten, and at least one, may be an outlier from the line of the others, by the t-test of its
deleted residual with Bonferroni's correction; it is excluded and reported.

The flights left are reported only if the slope is above zero with 99.5 % confidence (stricter than the
interval, because the test is repeated after every flight), if the flights do not depart from a straight
line, and if the interval begins within three times the span of the flights. A repair breaks the straight
line: the user must give its date.

References
----------
R. C. Paule and J. Mandel (1982), Journal of Research of the National Bureau of Standards 87:377.
G. Knapp and J. Hartung (2003), Statistics in Medicine 22:2693.
G. V. Bayley and J. M. Hammersley (1946), Supplement to the Journal of the Royal Statistical Society 8:184.
E. C. Fieller (1954), Journal of the Royal Statistical Society B 16:175.
N. R. Draper and H. Smith (1998), Applied Regression Analysis, 3rd ed., sections 3.2 and 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.special import stdtr, stdtrit

from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import CENTRAL_95, NORMAL_99
from mavhums.health.decision.thresholds import (
    FLIGHTS_PER_OUTLIER,
    LEAST_ERROR_SHARE,
    MOST_AUTOCORRELATION,
    OUTLIER_PROBABILITY,
    STEP_FLIGHTS,
    STEP_LIKELIHOOD_RATIO,
    TREND_CONFIDENCE,
    TREND_FLIGHTS,
    TREND_REACH_SPANS,
)
from mavhums.health.estimation.random_effects import variance_between, weighted
from mavhums.report.assessment import Interval


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
    flights_left
        Flights after the last one until the line reaches the emergency limit; None if not known.
    reason
        Reason if ``flights_left`` is not known.
    """

    level: Interval
    per_flight: Interval
    between: float
    flights: int
    left_out: tuple[int, ...]
    flights_left: Interval | None
    reason: str | None


@dataclass(frozen=True, slots=True)
class _TrendLine:
    """Level at the last flight and slope, their covariance, and the factor that widened it."""

    level: float
    slope: float
    covariance: Array
    widening: float
    between: float
    deleted: Array
    departure: str | None
    freedom: int


def fit_trend(numbers: Array, values: Array, errors: Array, emergency: float | None) -> Trend | None:
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
    emergency
        Emergency limit of the indicator; None if there is none.

    Examples
    --------
    >>> flights = np.arange(40.0)
    >>> noise = 0.004 * np.sin(np.arange(40) * 2.4)
    >>> trend = fit_trend(flights, 0.225 + 0.005 * flights + noise, np.full(40, 0.002), 0.875)
    >>> left = trend.flights_left
    >>> round(left.low), round(left.estimate), round(left.high)
    (89, 91, 93)
    """
    if len(values) < TREND_FLIGHTS:
        return None
    errors = np.maximum(errors, max(LEAST_ERROR_SHARE * errors.max(), 1e-9 * np.abs(values).max(), 1e-12))
    kept, line = _without_outliers(numbers, values, errors)
    t = float(stdtrit(line.freedom, CENTRAL_95))
    outlook = _outlook(line, emergency, t, TREND_REACH_SPANS * float(np.ptp(numbers)))
    # Whether it is an outlier or the beginning of the end only the next flights tell.
    if not kept[-1]:
        outlook = "its last flight lies far off the line of the others; the next ones will tell"
    return Trend(
        level=_interval(line.level, t * sqrt(line.covariance[0, 0])),
        per_flight=_interval(line.slope, t * sqrt(line.covariance[1, 1])),
        between=line.between,
        flights=int(np.count_nonzero(kept)),
        left_out=tuple(int(place) for place in np.flatnonzero(~kept)),
        flights_left=None if isinstance(outlook, str) else outlook,
        reason=outlook if isinstance(outlook, str) else None,
    )


def _without_outliers(numbers: Array, values: Array, errors: Array) -> tuple[Flags, _TrendLine]:
    """Exclude outliers: repeatedly the flight farthest from the line of the others, up to one in ten."""
    kept = np.ones(len(values), dtype=np.bool_)
    line = _fit(numbers, values, errors, numbers[-1])
    for _ in range(max(1, len(values) // FLIGHTS_PER_OUTLIER)):
        n = len(line.deleted)
        worst = int(np.argmax(np.abs(line.deleted)))
        chance = 2 * n * float(stdtr(n - 3, -abs(line.deleted[worst])))
        if chance > OUTLIER_PROBABILITY:
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
    widening = _widening(residuals)
    leverage = weights * np.einsum("ij,jk,ik->i", design, inverse, design)
    free = np.clip(1 - leverage, 1e-9, None)
    others = (scale * freedom - residuals**2 / free) / (freedom - 1)
    deleted = residuals / np.sqrt(free * np.maximum(others, 1e-12 * scale + 1e-24))
    return _TrendLine(
        level=float(coefficients[0]),
        slope=float(coefficients[1]),
        covariance=widening * scale * inverse,
        widening=widening,
        between=sqrt(between),
        deleted=deleted,
        departure=departure(numbers, values, weights),
        freedom=freedom,
    )


def _widening(residuals: Array) -> float:
    """Return the variance inflation from correlated neighbouring flights; 1 if they are uncorrelated."""
    total = float(residuals @ residuals)
    alike = float(residuals[:-1] @ residuals[1:]) / total if total > 0 else 0.0
    # Neighbours that differ more than by chance do not make the line more certain.
    alike = min(max(alike, 0.0), MOST_AUTOCORRELATION)
    return (1 + alike) / (1 - alike)


def _outlook(line: _TrendLine, emergency: float | None, t: float, reach: float) -> Interval | str:
    """Return the remaining useful life in flights, or the reason why it is not known."""
    if emergency is not None and line.level >= emergency:
        return "the emergency limit is reached"
    slope_error = float(stdtrit(line.freedom, TREND_CONFIDENCE)) * sqrt(line.covariance[1, 1])
    # Without the widening: a course that is no line is named as such, and not called flat.
    grows = line.slope > slope_error / sqrt(line.widening)
    if grows and line.departure:
        return f"{line.departure}, so a straight line does not extrapolate"
    if line.slope <= slope_error:
        return "no growth beyond the scatter between flights"
    if emergency is None:
        return "it grows, but has no emergency limit"
    left = _flights_left(line, emergency, t)
    if left.low > reach:
        times = f"over {TREND_REACH_SPANS:g} times as far ahead as the flights reach back"
        return f"it grows, and its limit is {times}"
    return left


def _flights_left(line: _TrendLine, limit: float, t: float) -> Interval:
    """Return Fieller's interval, the roots of (level + slope·x − limit)² = t²·variance of the line at x."""
    missing = limit - line.level
    (v_level, v_both), (_, v_slope) = line.covariance * t**2
    # Positive, because the slope is significant: the interval is bounded.
    square = line.slope**2 - v_slope
    linear = -line.slope * missing - v_both
    constant = missing**2 - v_level
    root = sqrt(max(linear**2 - square * constant, 0.0))
    low, high = (-linear - root) / square, (-linear + root) / square
    return Interval(estimate=missing / line.slope, low=max(low, 0.0), high=high)


def _interval(estimate: float, half: float) -> Interval:
    return Interval(estimate=estimate, low=estimate - half, high=estimate + half)


def departure(numbers: Array, values: Array, weights: Array) -> str | None:
    """Describe how flights depart from their weighted least-squares line; None if they do not.

    They depart from it if one step between two levels is twenty times as likely as the line, if a square
    term is significant at 1 %, or if the lag-one autocorrelation of the residuals is significant at 0.5 %.

    Parameters
    ----------
    numbers, values, weights
        Numbers, values and weights of the flights in time order, shape (n,), n ≥ 4; weights are inverse
        variances.

    Examples
    --------
    >>> flights = np.arange(20.0)
    >>> departure(flights, 0.2 + 0.01 * flights + 0.003 * np.cos(2.4 * flights), np.ones(20))
    >>> departure(flights, 0.2 + 0.1 * (flights > 11) + 0.003 * np.cos(2.4 * flights), np.ones(20))
    'it changed in one step'
    """
    root = np.sqrt(weights)
    at = (numbers - numbers.mean()) / np.ptp(numbers)
    line = _residuals(at, values, root, 1)
    squares = float(line @ line)
    # Sums of squares compare as likelihoods to the power of 2/n.
    if _best_step(values, weights) < squares * STEP_LIKELIHOOD_RATIO ** (-2 / len(values)):
        return "it changed in one step"
    curve = _residuals(at, values, root, 2)
    freedom = len(values) - 3
    gain = squares - float(curve @ curve)
    if gain * freedom > stdtrit(freedom, TREND_CONFIDENCE) ** 2 * float(curve @ curve):
        return "it grows ever faster or slower"
    if float(line[:-1] @ line[1:]) * sqrt(len(line)) > NORMAL_99 * squares:
        return "it comes and goes, as with a season"
    return None


def _residuals(at: Array, values: Array, root: Array, degree: int) -> Array:
    design = np.vander(at, degree + 1) * root[:, None]
    coefficients = np.linalg.lstsq(design, values * root)[0]
    residuals: Array = values * root - design @ coefficients
    return residuals


def _best_step(values: Array, weights: Array) -> float:
    """Return the smallest weighted sum of squares about two levels, each of at least two flights."""
    values = values - values.mean()
    first = slice(STEP_FLIGHTS - 1, len(values) - STEP_FLIGHTS)
    before, moment = np.cumsum(weights), np.cumsum(weights * values)
    explained = moment[first] ** 2 / before[first]
    explained += (moment[-1] - moment[first]) ** 2 / (before[-1] - before[first])
    return float(weights @ values**2 - explained.max())
