"""The line through an actuator's flights: against known solutions, and against many simulated histories."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import brentq

from mavhums.health.decision.thresholds import TREND_FLIGHTS, TREND_REACH_SPANS
from mavhums.health.decision.trend import Trend, departure, fit_trend

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator, int], Array]

EMERGENCY = 0.875
BETWEEN = 0.008


def normal(rng: np.random.Generator, n: int) -> Array:
    return rng.standard_normal(n)


def heavy(rng: np.random.Generator, n: int) -> Array:
    """Student's t with 5 degrees of freedom, kurtosis 9, of variance one."""
    return np.asarray(rng.standard_t(5, n) / np.sqrt(5 / 3))


def history(
    rng: np.random.Generator, n: int, slope: float, draw: Draw = normal, start: float = 0.225
) -> tuple[Array, Array, Array]:
    """Numbers, values and standard errors of flights whose friction grows from ``start``, N·m."""
    numbers = np.arange(1.0, n + 1)
    errors = 0.002 * rng.uniform(0.7, 1.8, n)
    scatter = BETWEEN * draw(rng, n) + errors * rng.standard_normal(n)
    return numbers, start + slope * numbers + scatter, errors


def fitted(numbers: Array, values: Array, errors: Array, emergency: float | None = EMERGENCY) -> Trend:
    trend = fit_trend(numbers, values, errors, emergency)
    assert trend is not None
    return trend


@pytest.mark.parametrize("draw", [normal, heavy])
@pytest.mark.parametrize(("flights", "slope"), [(10, 0.02), (30, 0.008), (80, 0.004)])
def test_the_interval_covers_the_flights_left(draw: Draw, flights: int, slope: float) -> None:
    rng = np.random.default_rng(flights)
    truth = (EMERGENCY - 0.225) / slope - flights
    told = [fitted(*history(rng, flights, slope, draw)).flights_left for _ in range(1000)]
    covered = [left.low <= truth <= left.high for left in told if left is not None]
    assert len(covered) > 970
    assert 0.93 <= np.mean(covered) <= 0.97


@pytest.mark.parametrize("draw", [normal, heavy])
@pytest.mark.parametrize("flights", [TREND_FLIGHTS, 20, 60])
def test_flat_histories_have_no_flights_left(draw: Draw, flights: int) -> None:
    """The limit lies a little above, so that nothing but the lack of growth forbids an interval."""
    rng = np.random.default_rng(flights)
    told = [fitted(*history(rng, flights, 0.0, draw), 0.245).flights_left for _ in range(1000)]
    assert sum(left is not None for left in told) <= 20


@pytest.mark.slow
def test_flat_histories_have_none_at_any_time() -> None:
    """A maintainer asks after each of sixty flights: at most one aircraft in twenty ever shows a trend."""
    rng = np.random.default_rng(3)
    false = 0
    for _ in range(80):
        numbers, values, errors = history(rng, 60, 0.0, heavy)
        false += any(
            fitted(numbers[:n], values[:n], errors[:n]).flights_left is not None
            for n in range(TREND_FLIGHTS, 61)
        )
    assert false <= 4


def test_equal_errors_make_it_plain_least_squares() -> None:
    rng = np.random.default_rng(5)
    numbers, values, _ = history(rng, 25, 0.006)
    trend = fitted(numbers, values, np.full(25, 0.002))
    plain = stats.linregress(numbers, values)
    half = stats.t.ppf(0.975, 23) * plain.stderr
    assert trend.per_flight.estimate == pytest.approx(plain.slope, rel=1e-9)
    assert trend.per_flight.low == pytest.approx(plain.slope - half, rel=1e-6)
    assert trend.level.estimate == pytest.approx(plain.intercept + plain.slope * 25, rel=1e-9)
    scatter = np.std(values - plain.intercept - plain.slope * numbers) * np.sqrt(25 / 23)
    assert np.hypot(trend.between, 0.002) == pytest.approx(scatter, rel=1e-4)


def test_the_interval_is_where_the_confidence_band_meets_the_limit() -> None:
    numbers, values, _ = history(np.random.default_rng(6), 20, 0.01)
    left = fitted(numbers, values, np.full(20, 0.002)).flights_left
    assert left is not None
    plain = stats.linregress(numbers, values)
    rest = values - plain.intercept - plain.slope * numbers
    variance = rest @ rest / 18
    spread = np.sum((numbers - numbers.mean()) ** 2)
    t = stats.t.ppf(0.975, 18)

    def band(ahead: float, side: float) -> float:
        at = numbers[-1] + ahead
        error = np.sqrt(variance * (1 / 20 + (at - numbers.mean()) ** 2 / spread))
        return float(plain.intercept + plain.slope * at + side * t * error - EMERGENCY)

    assert left.low == pytest.approx(brentq(band, 0, 200, args=(1.0,)), rel=1e-6)
    assert left.high == pytest.approx(brentq(band, 0, 200, args=(-1.0,)), rel=1e-6)


def test_flights_that_are_like_their_neighbours_tell_less() -> None:
    """Weather that lasts a few flights: without heed of it, seven intervals in ten hold the truth."""
    rng = np.random.default_rng(14)
    inside = []
    for _ in range(500):
        numbers, values, errors = history(rng, 30, 0.01, lambda rng, n: np.zeros(n))
        weather = rng.standard_normal(30)
        for k in range(1, 30):
            weather[k] = 0.5 * weather[k - 1] + np.sqrt(0.75) * weather[k]
        slope = fitted(numbers, values + BETWEEN * weather, errors).per_flight
        inside.append(slope.low <= 0.01 <= slope.high)
    assert np.mean(inside) > 0.82


def test_a_flight_that_is_known_badly_counts_little() -> None:
    numbers = np.arange(20.0)
    values = 0.225 + 0.01 * numbers + 0.001 * np.cos(numbers * 2.4)
    errors = np.full(20, 0.002)
    values[10] += 0.05
    errors[10] = 0.05
    trend = fitted(numbers, values, errors)
    assert trend.left_out == ()
    assert trend.per_flight.estimate == pytest.approx(0.01, abs=2e-4)
    assert trend.between == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("place", [0, 7, 19])
@pytest.mark.parametrize("jump", [-0.15, 0.15])
def test_one_flight_far_off_is_left_out(place: int, jump: float) -> None:
    numbers, values, errors = history(np.random.default_rng(8), 20, 0.01)
    without = fitted(numbers, values, errors)
    values[place] += jump
    trend = fitted(numbers, values, errors)
    assert trend.left_out == (place,)
    assert trend.flights == 19
    assert trend.per_flight.estimate == pytest.approx(without.per_flight.estimate, abs=1e-3)
    truth = (EMERGENCY - 0.225) / 0.01 - 20
    if place == 19:  # perhaps the beginning of a step
        assert trend.flights_left is None
        assert "last flight lies far off" in str(trend.reason)
    else:
        assert trend.flights_left is not None
        assert trend.flights_left.low <= truth <= trend.flights_left.high


def test_an_outlier_makes_no_false_trend() -> None:
    rng = np.random.default_rng(9)
    false = 0
    for _ in range(500):
        numbers, values, errors = history(rng, 20, 0.0)
        values[rng.integers(20)] += rng.choice([-0.1, 0.1])
        false += fitted(numbers, values, errors, 0.245).flights_left is not None
    assert false <= 10


def test_few_flights_make_no_trend() -> None:
    numbers, values, errors = history(np.random.default_rng(1), TREND_FLIGHTS, 0.05)
    assert fit_trend(numbers[1:], values[1:], errors[1:], EMERGENCY) is None
    assert fitted(numbers, values, errors).flights_left is not None


def test_what_is_no_line_is_not_extrapolated() -> None:
    numbers, values, errors = history(np.random.default_rng(10), 40, 0.0)
    step = fitted(numbers, values + 0.15 * (numbers > 20), errors)
    faster = fitted(numbers, values + 0.3 * (numbers / 40) ** 3, errors)
    season = fitted(numbers, values + 0.004 * numbers + 0.05 * np.sin(numbers / 2), errors)
    for trend, why in ((step, "in one step"), (faster, "ever faster"), (season, "as with a season")):
        assert trend.flights_left is None
        assert why in str(trend.reason)
        assert "a straight line does not extrapolate" in str(trend.reason)


@pytest.mark.parametrize("n", [TREND_FLIGHTS, 20, 60])
def test_lines_are_rarely_taken_for_something_else(n: int) -> None:
    rng = np.random.default_rng(n)
    said = []
    for _ in range(300):
        numbers, values, errors = history(rng, n, 0.2 / n, heavy)
        said.append(departure(numbers, values, 1 / (BETWEEN**2 + errors**2)))
    assert sum(word is not None for word in said) <= 12


@pytest.mark.parametrize("n", [TREND_FLIGHTS, 20, 60])
def test_departures_are_seen_in_few_flights_too(n: int) -> None:
    at = np.linspace(0, 1, n)
    shapes = {
        "it changed in one step": 0.1 * (at > 0.5),
        "it grows ever faster or slower": 0.2 * at**3,
    }
    for word, shape in shapes.items():
        rng = np.random.default_rng(n)
        for _ in range(50):
            numbers, values, errors = history(rng, n, 0.0)
            assert departure(numbers, values + shape, 1 / (BETWEEN**2 + errors**2)) == word


def test_the_limit_may_not_lie_too_far_ahead() -> None:
    numbers, values, errors = history(np.random.default_rng(11), 30, 0.01)
    level = fitted(numbers, values, errors).level.estimate
    near, far = (
        fitted(numbers, values, errors, level + 0.01 * 29 * TREND_REACH_SPANS * by) for by in (0.95, 1.05)
    )
    assert near.flights_left is not None
    assert far.flights_left is None
    assert "3 times as far ahead" in str(far.reason)


def test_reasons_are_said() -> None:
    numbers, values, errors = history(np.random.default_rng(12), 30, 0.01)
    assert fitted(numbers, values, errors, None).reason == "it grows, but has no emergency limit"
    assert fitted(numbers, values, errors, 0.4).reason == "the emergency limit is reached"
    falling = fitted(numbers, 0.8 - values, errors)
    assert falling.reason == "no growth beyond the scatter between flights"
    assert falling.flights_left is None


@given(
    st.lists(st.floats(-1e12, 1e12), min_size=TREND_FLIGHTS, max_size=30),
    st.lists(st.floats(0, 1e12), min_size=30, max_size=30),
    st.one_of(st.none(), st.floats(-1e12, 1e12)),
)
def test_any_numbers_make_finite_intervals(
    values: list[float], errors: list[float], emergency: float | None
) -> None:
    n = len(values)
    trend = fitted(np.arange(1.0, n + 1), np.array(values), np.array(errors[:n]), emergency)
    assert trend.level.low <= trend.level.high
    if trend.flights_left is not None:
        assert 0 <= trend.flights_left.low <= trend.flights_left.estimate <= trend.flights_left.high
    assert (trend.flights_left is None) == (trend.reason is not None)


@given(st.floats(0.01, 100), st.floats(-10, 10), st.integers(0, 500))
def test_units_and_the_first_flight_do_not_matter(scale: float, shift: float, first: int) -> None:
    numbers, values, errors = history(np.random.default_rng(13), 20, 0.01)
    plain = fitted(numbers, values, errors)
    other = fitted(numbers + first, values * scale + shift, errors * scale, EMERGENCY * scale + shift)
    assert plain.flights_left is not None
    assert other.flights_left is not None
    assert other.flights_left.low == pytest.approx(plain.flights_left.low, rel=1e-3)
    assert other.flights_left.high == pytest.approx(plain.flights_left.high, rel=1e-3)
