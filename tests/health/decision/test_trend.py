"""The line through an actuator's flights: against known solutions, and against many simulated histories."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from mavhums.health.decision.thresholds import MOST_AUTOCORRELATION, MOST_FLIGHT_TAIL, TREND_FLIGHTS
from mavhums.health.decision.trend import Trend, fit_trend, widening
from tests.health.decision.lines import beside_the_line
from tests.health.present import present

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator, int], Array]

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


def fitted(numbers: Array, values: Array, errors: Array) -> Trend:
    return present(fit_trend(numbers, values, errors))


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
    at_last = scatter * np.sqrt(1 / 25 + 12**2 / (25 * np.var(numbers)))
    assert trend.level.high - trend.level.estimate == pytest.approx(stats.t.ppf(0.975, 23) * at_last)
    assert np.hypot(trend.between, 0.002) == pytest.approx(scatter, rel=1e-4)


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


@pytest.mark.parametrize(("flights", "count"), [(TREND_FLIGHTS, 1), (19, 1), (20, 2), (29, 2), (30, 3)])
def test_one_flight_in_ten_may_be_left_out_and_one_of_any_number(flights: int, count: int) -> None:
    """Three are off, each ten times as far as the next: the farthest go."""
    numbers, values, errors = history(np.random.default_rng(8), flights, 0.01)
    places = [5, 2, 6]
    values[places] += [1000.0, -100.0, 10.0]
    assert fitted(numbers, values, errors).left_out == tuple(sorted(places[:count]))


@pytest.mark.parametrize(("share", "left_out"), [(0.97, True), (1.03, False)])
def test_a_flight_is_left_out_that_chance_hardly_puts_anywhere_so_far_off(
    share: float, left_out: bool
) -> None:
    """It is compared with the line of the others, and may be any of them, to either side."""
    n, place = 20, 7
    numbers, values, _ = history(np.random.default_rng(8), n, 0.01)
    values[place] = beside_the_line(numbers, values, place, share * MOST_FLIGHT_TAIL / n)
    assert fitted(numbers, values, np.full(n, 0.002)).left_out == ((place,) if left_out else ())


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_neighbours_that_are_alike_widen_the_line(unit: float) -> None:
    """By (1 + r)/(1 − r) of their autocorrelation r, up to a limit; those that alternate do not narrow it."""
    assert widening(unit * np.array([1.0, 1.0, -1.0, -1.0, 1.0])) == pytest.approx(1.0)
    assert widening(unit * np.array([1.0, 1.0, 1.0, -1.0, -1.0])) == pytest.approx(1.4 / 0.6)
    most = (1.0 + MOST_AUTOCORRELATION) / (1.0 - MOST_AUTOCORRELATION)
    assert widening(np.full(50, unit)) == pytest.approx(most)
    assert widening(unit * np.array([1.0, -1.0, 1.0, -1.0])) == 1.0
    assert widening(np.zeros(5)) == 1.0


def test_few_flights_make_no_trend() -> None:
    numbers, values, errors = history(np.random.default_rng(1), TREND_FLIGHTS, 0.05)
    assert fit_trend(numbers[1:], values[1:], errors[1:]) is None
    assert fitted(numbers, values, errors).flights == TREND_FLIGHTS


@given(
    st.lists(st.floats(-1e12, 1e12), min_size=TREND_FLIGHTS, max_size=30),
    st.lists(st.floats(0, 1e12), min_size=30, max_size=30),
)
def test_any_numbers_make_finite_intervals(values: list[float], errors: list[float]) -> None:
    n = len(values)
    trend = fitted(np.arange(1.0, n + 1), np.array(values), np.array(errors[:n]))
    assert trend.level.low <= trend.level.high


@given(st.floats(0.01, 100), st.floats(-10, 10), st.integers(0, 500))
def test_units_and_the_first_flight_do_not_matter(scale: float, shift: float, first: int) -> None:
    numbers, values, errors = history(np.random.default_rng(13), 20, 0.01)
    plain = fitted(numbers, values, errors).per_flight
    other = fitted(numbers + first, values * scale + shift, errors * scale).per_flight
    assert other.low == pytest.approx(scale * plain.low, rel=1e-3)
    assert other.high == pytest.approx(scale * plain.high, rel=1e-3)
