"""Growth over flights: a sequential test that may be asked after every flight, and the flights to a limit.

An indicator stays at a level and grows by the same amount a flight from some flight on, or it does not grow.
Which flight that is, is unknown: the Bayes factors of all are summed, half the weight on the first flight and
the rest spread evenly over 200 flights, as Shiryaev and Roberts do. Each is the Bayes factor of a slope with
unknown level and scatter (right Haar prior), in closed form; under no growth their weighted sum is a
supermartingale, so by Ville's inequality it ever reaches 1/p with probability p at most, however often it is
looked at. Neighbouring flights that are alike count less, by the variance inflation of their lag-one
correlation. A flight far off the best line is left out until the next ones confirm it.

The line from the first flight on is the course of an indicator that does not grow, too: its slope is shown
with its interval, by Student's t. Paule and Mandel's equation weights flights by the variance between them.

A step between two flights (a repair, a swap, damage) ends a course: growth is sought in the flights since the
last one, and the scatter of the flights before still counts.

References
----------
G. V. Bayley and J. M. Hammersley (1946), Supplement to the Journal of the Royal Statistical Society 8:184.
G. Knapp and J. Hartung (2003), Statistics in Medicine 22:2693: the interval of the line.
M. Lindon, D. W. Ham, M. Tingley and I. Bojinov (2022), arXiv:2210.08589: anytime-valid linear models.
J. Shin, A. Ramdas and A. Rinaldo (2024), New England J. of Statistics in Data Science 2:229: e-detectors.
F. Liang et al. (2008), Journal of the American Statistical Association 103:410: the Bayes factor of a slope.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from math import log, sqrt
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.statistics import CENTRAL_95, t_probability, t_quantile
from mavhums.health.decision.thresholds import (
    AGREEING,
    GROWTH_CHANCE,
    GROWTH_SCALES,
    HORIZON_FLIGHTS,
    LASTING_FLIGHTS,
    MOST_AUTOCORRELATION,
    MOST_FLIGHT_TAIL,
    STEP_SIZE,
    TREND_FLIGHTS,
)
from mavhums.health.estimation.random_effects import variance_between
from mavhums.health.estimation.thresholds import BASELINE_FLIGHTS, LEAST_ERROR_SHARE
from mavhums.health.sequential import EXCLUDING
from mavhums.results.verdict import Interval

_MOST_FLIGHTS = 1e6  # the search for a crossing ends there: no aircraft flies more
_LOW, _MIDDLE, _HIGH = 0.025, 0.5, 0.975
_TO_DEVIATION = 1.4826 / sqrt(2.0)  # median absolute difference of neighbours → standard deviation


@dataclass(frozen=True, slots=True, eq=False)
class _Courses:
    """The courses that an indicator may have taken since the last step, one for each first growing flight.

    ``first`` are indices of flights; the other arrays have their shape. ``log_odds`` returns each one's
    logarithm of weight and Bayes factor, which takes the longest. ``level`` and ``slope`` are the line at the
    last flight, ``ahead`` is how far the last flight lies from the middle of the growing ones, ``spread``
    their sum of squares. ``between`` is the standard deviation between flights, without measurement errors.
    """

    first: Integers
    log_odds: Callable[[], Array]
    level: Array
    slope: Array
    ahead: Array
    spread: Array
    variance: Array
    total_weight: float
    freedom: float
    between: float
    residuals: Array
    hat: Array

    @property
    def likeliest(self) -> int:
        """Index of the course with the best odds."""
        return int(np.argmax(self.log_odds()))

    def likely(self) -> tuple[Array, _Courses]:
        """Return the courses that count, after their weights: others weigh less than a rounding error."""
        odds = self.log_odds()
        kept = odds > odds.max() - 45
        names = ("first", "level", "slope", "ahead", "spread", "variance")
        some = replace(self, **{name: getattr(self, name)[kept] for name in names})
        return np.exp(odds[kept] - np.logaddexp.reduce(odds)), some


class Line(NamedTuple):
    """A straight line through all flights: at the last one, and a flight; the deviation between flights."""

    level: Interval
    per_flight: Interval
    between: float


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """The course of an indicator over its flights.

    Attributes
    ----------
    grows
        Whether growth is certain.
    evidence
        Weighted Bayes factor of growth, as a logarithm.
    since
        Index of the flight after which it most likely grows, or of the first one.
    left_out
        Indices of the flights too far off the line.
    """

    grows: bool
    evidence: float
    since: int
    left_out: tuple[int, ...]
    _courses: _Courses

    @property
    def per_flight(self) -> Interval:
        """The slope of the line, averaged over the flights at which growth may begin; 95 % interval."""
        weights, some = self._courses.likely()
        errors = np.sqrt(some.variance / some.spread)
        middle = float(weights @ some.slope)
        width = float(np.max(np.abs(some.slope - middle)) + 50 * np.max(errors)) or 1.0

        def below(offset: float) -> float:
            at = middle - width + offset
            return float(weights @ t_probability(some.freedom, (at - some.slope) / errors))

        low, high = (
            min(_quantile(below, share, 2 * width), 2 * width) + middle - width for share in (_LOW, _HIGH)
        )
        return Interval(estimate=min(max(middle, low), high), low=low, high=high)

    @property
    def line(self) -> Line:
        """The line on which the indicator changes from the first flight on; 95 % intervals."""
        of, at_first = self._courses, 0
        half = t_quantile(of.freedom, CENTRAL_95) * sqrt(of.variance[at_first])
        spread, ahead = float(of.spread[at_first]), float(of.ahead[at_first])
        return Line(
            level=Interval.around(
                float(of.level[at_first]), half * sqrt(1 / of.total_weight + ahead**2 / spread)
            ),
            per_flight=Interval.around(float(of.slope[at_first]), half / sqrt(spread)),
            between=of.between,
        )

    def flights_left(self, limit: float) -> tuple[float, float, float]:
        """Return in how many flights the line reaches a limit: low end, median and high end of 95 %.

        They are infinite where it need not reach it.
        """
        weights, some = self._courses.likely()

        def reached(ahead: float) -> float:
            error = np.sqrt(some.variance * (1 / some.total_weight + (some.ahead + ahead) ** 2 / some.spread))
            line = some.level + some.slope * ahead
            return float(weights @ t_probability(some.freedom, (line - limit) / error))

        low, middle, high = (_quantile(reached, share) for share in (_LOW, _MIDDLE, _HIGH))
        return low, middle, high


def course_of(numbers: Array, values: Array, errors: Array, *, begin: int = 0) -> Course | None:
    """Return the course of an indicator; None for fewer than ``TREND_FLIGHTS`` flights since ``begin``.

    Parameters
    ----------
    numbers
        Flight numbers, increasing, shape (n,).
    values
        Values of the indicator, which a fault raises, shape (n,), in any unit.
    errors
        Standard errors of measurement, shape (n,), in the same unit.
    begin
        Index of the first flight after the last step; of the flights before only their scatter counts.

    Examples
    --------
    >>> flights = np.arange(40.0)
    >>> noise = 0.004 * np.sin(np.arange(40) * 2.4)
    >>> course = course_of(flights, 0.225 + 0.005 * flights + noise, np.full(40, 0.002))
    >>> course.grows, [round(left) for left in course.flights_left(0.875)]
    (True, [89, 91, 93])
    >>> course_of(flights, 0.225 + noise, np.full(40, 0.002)).grows
    False
    """
    if len(values) - begin < TREND_FLIGHTS:
        return None
    errors = np.maximum(errors, max(LEAST_ERROR_SHARE * errors.max(), 1e-9 * np.abs(values).max(), 1e-12))
    squares, freedom = _scatter_before(numbers[:begin], values[:begin], errors[:begin])
    kept, courses = _without_outliers(numbers[begin:], values[begin:], errors[begin:], (squares, freedom))
    evidence = float(np.logaddexp.reduce(courses.log_odds()))
    return Course(
        grows=evidence >= -log(GROWTH_CHANCE),
        evidence=evidence,
        since=begin + int(np.flatnonzero(kept)[courses.first[courses.likeliest]]),
        left_out=tuple(begin + int(place) for place in np.flatnonzero(~kept)),
        _courses=courses,
    )


def last_step(values: Array, errors: Array) -> int | None:
    """Return the index of the first flight after the last step; None if there is none.

    The mean of the flights after it leaves that of those before by seven standard errors, by the scatter of
    neighbours, which no growth raises; and beside the step a line through the same flights is unlikely.

    Parameters
    ----------
    values, errors
        Values and standard errors of measurement of the flights in time order, shape (n,).

    Examples
    --------
    >>> values = np.array([0.40, 0.41, 0.42, 0.43, 0.44, 0.45, 0.46, 0.47, 0.21, 0.22, 0.23])
    >>> last_step(values, np.full(11, 0.004))
    8
    """
    n = len(values)
    if n < TREND_FLIGHTS:
        return None
    scatter = max(float(np.median(np.abs(np.diff(values)))) * _TO_DEVIATION, float(np.median(errors)))
    places = np.arange(TREND_FLIGHTS // 2, n - AGREEING + 1)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    first, last = np.maximum(places - LASTING_FLIGHTS, 0), np.minimum(places + LASTING_FLIGHTS, n)
    size = (sums[last] - sums[places]) / (last - places) - (sums[places] - sums[first]) / (places - first)
    least = STEP_SIZE * scatter * np.sqrt(1 / (places - first) + 1 / (last - places))
    for place in places[np.abs(size) > least][::-1]:
        before, after = values[:place], values[place:]
        # Medians, too: one flight far off moves a mean.
        across = np.median(after[:LASTING_FLIGHTS]) - np.median(before[-LASTING_FLIGHTS:])
        if abs(across) > least[place - places[0]] and _is_step(
            before[-TREND_FLIGHTS:], after[:TREND_FLIGHTS], scatter
        ):
            return int(place)
    return None


def _is_step(before: Array, after: Array, scatter: float) -> bool:
    """Return whether two levels are likelier than one line, and than every neighbouring place of the step."""
    both = np.concatenate([before, after])
    at = np.arange(len(both)) - (len(both) - 1) / 2
    centred = both - both.mean()
    line = float(centred @ centred - (at @ centred) ** 2 / (at @ at))
    levels = _squares(before) + _squares(after)
    gain = EXCLUDING * 2 * scatter**2
    earlier = _squares(both[: len(before) - 1]) + _squares(both[len(before) - 1 :])
    later = _squares(both[: len(before) + 1]) + _squares(both[len(before) + 1 :])
    return line - levels > gain and levels <= min(earlier, later)


def _squares(values: Array) -> float:
    return float(np.var(values) * len(values))


def _scatter_before(numbers: Array, values: Array, errors: Array) -> tuple[float, float]:
    """Return the sum of squares of the flights before a step about their course, and its freedom."""
    if len(values) < TREND_FLIGHTS:
        return 0.0, 0.0
    courses = _courses(numbers, values, errors, (0.0, 0.0))
    return float(courses.variance[courses.likeliest]) * courses.freedom, courses.freedom


def _without_outliers(
    numbers: Array, values: Array, errors: Array, known: tuple[float, float]
) -> tuple[Flags, _Courses]:
    """Leave out, one by one, the flight farthest off the likeliest course of the others, up to one in ten."""
    kept = np.ones(len(values), dtype=np.bool_)
    courses = _courses(numbers, values, errors, known)
    # More than one of as many as a baseline has are another course.
    for _ in range(max(1, len(values) // BASELINE_FLIGHTS)):
        squares = courses.residuals**2 / np.clip(1 - courses.hat, 1e-9, None)
        worst = int(np.argmax(squares))
        # A flight that is far off even beside the course that scatters most needs no likeliest course.
        if not _is_off(squares[worst], courses.variance.max(), courses) and not _is_off(
            squares[worst], courses.variance[courses.likeliest], courses
        ):
            break
        kept[np.flatnonzero(kept)[worst]] = False
        courses = _courses(numbers[kept], values[kept], errors[kept], known)
    return kept, courses


def _is_off(square: float, scale: float, courses: _Courses) -> bool:
    """Return whether a flight is too far off a course of this variance, by its deleted residual."""
    freedom = courses.freedom - 1
    others = (scale * courses.freedom - square) / freedom
    deleted = sqrt(square / max(others, 1e-12 * scale + 1e-300))
    return 2 * len(courses.residuals) * t_probability(freedom, -deleted) <= MOST_FLIGHT_TAIL


def _courses(numbers: Array, values: Array, errors: Array, known: tuple[float, float]) -> _Courses:
    """Return all courses; ``known`` is the sum of squares of earlier flights and its freedom."""
    n = len(numbers)
    design = np.column_stack([np.ones_like(numbers), numbers - numbers.mean()])
    between = variance_between(design, values, errors)
    weights = 1 / (errors**2 + between)
    # The weights matter against each other only: their mean is 1, and the scatter is the values' own.
    weights = weights / weights.mean()
    first = np.arange(max(n - LASTING_FLIGHTS, 1))
    apart = np.diff(numbers)
    # Sums over the flights after each one: of weights, and of the flights flown since then and their squares.
    after = _sums_after(weights[1:])
    flown = _sums_after(apart * after)
    squared = _sums_after(apart * (2 * flown - apart * after))[first]
    middle = flown[first] / n
    ahead = numbers[-1] - numbers[first] - middle
    spread = squared - n * middle**2
    rest = values - float(weights @ values) / n
    # Flights that agree to the last digit scatter, too: nothing is known of it but that it is small.
    least = n * (1e-6 * float(np.abs(values).max()) + 1e-9) ** 2
    total = float(weights @ rest**2) + known[0] + least
    product = _sums_after(apart * _sums_after((weights * rest)[1:]))[first]
    slope = product / spread
    squares = np.maximum(total - product**2 / spread, 1e-12 * total + 1e-300)
    best = int(np.argmin(squares))
    likeliest = np.maximum(numbers - numbers[best], 0.0) - middle[best]
    residuals = np.sqrt(weights) * (rest - slope[best] * likeliest)
    # Smaller residuals are rounding errors, whose correlation differs between processors.
    inflation = widening(residuals) if float(residuals @ residuals) > least else 1.0
    waited = np.diff(numbers[first], prepend=numbers[0])
    prior = np.where(first == 0, 0.5, 0.5 * waited / HORIZON_FLIGHTS)
    freedom = n - 2 + known[1]

    @cache
    def log_odds() -> Array:
        return np.log(prior) + _log_bayes_factors(total, product, spread, freedom + 1, inflation)

    return _Courses(
        first=first,
        log_odds=log_odds,
        level=values @ weights / n + slope * ahead,
        slope=slope,
        ahead=ahead,
        spread=spread,
        variance=inflation * squares / freedom,
        total_weight=float(n),
        freedom=freedom,
        between=sqrt(between),
        residuals=residuals,
        hat=weights * (1 / n + likeliest**2 / spread[best]),
    )


def widening(residuals: Array) -> float:
    """Return the variance inflation from correlated neighbouring flights; 1 if they are uncorrelated."""
    total = float(residuals @ residuals)
    alike = float(residuals[:-1] @ residuals[1:]) / total if total > 0 else 0.0
    # Neighbours that differ more than by chance do not make the line more certain.
    alike = min(max(alike, 0.0), MOST_AUTOCORRELATION)
    return (1 + alike) / (1 - alike)


def _sums_after(terms: Array) -> Array:
    """Return the sum of each term and all after it."""
    return np.cumsum(terms[::-1])[::-1]


def _log_bayes_factors(
    total: float, product: Array, spread: Array, freedom: float, inflation: float
) -> Array:
    """Return each course's logarithm of the Bayes factor of a rise, averaged over sizes of a slope."""
    prior = np.array(GROWTH_SCALES)[:, None] ** -2
    share = spread / (spread + prior)
    rest = np.maximum(total - share * product**2 / spread, 1e-12 * total + 1e-300)
    two_sided = 0.5 * np.log(1 - share) + freedom / 2 * np.log((total + 1e-300) / rest)
    error = np.sqrt(rest / freedom / (spread + prior))
    rising = np.log(2 * t_probability(freedom, share * product / spread / error) + 1e-300)
    averaged: Array = np.logaddexp.reduce(two_sided / inflation + rising, axis=0) - log(len(GROWTH_SCALES))
    return averaged


def _quantile(reached: Callable[[float], float], share: float, high: float = _MOST_FLIGHTS) -> float:
    """Return where an increasing probability reaches a share; infinite if it does not do so before."""
    if reached(0.0) >= share:
        return 0.0
    if reached(high) < share:
        return float("inf")
    from scipy.optimize import brentq  # 0.4 s to import, and most aircraft have no growth

    return float(brentq(lambda at: reached(at) - share, 0.0, high))
