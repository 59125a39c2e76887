"""Growth over flights: asked after every flight, on histories with and without it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from mavhums.health.decision.growth import Course, course_of, last_step, widening
from tests.present import present

TREND_FLIGHTS = 8

Array = NDArray[np.float64]

LIMIT = 0.375
LEVEL = 0.225


def history(
    seed: int, flights: int, slope: float = 0.0, *, begin: int = 0, scatter: float = 0.05
) -> tuple[Array, Array, Array]:
    """Numbers, values and errors of flights; the friction grows from flight ``begin`` on."""
    rng = np.random.default_rng([seed, flights])
    numbers = np.arange(1.0, flights + 1)
    grown = slope * np.maximum(numbers - begin, 0)
    return numbers, LEVEL + grown + LEVEL * scatter * rng.standard_normal(flights), np.full(flights, 0.002)


def course(numbers: Array, values: Array, errors: Array, begin: int = 0) -> Course:
    return present(course_of(numbers, values, errors, begin=begin))


def beside_the_line(numbers: Array, values: Array, place: int, chance: float) -> float:
    """Return a value above the line of the others that chance exceeds, to either side, so often."""
    others = np.delete(np.arange(len(numbers)), place)
    design = np.column_stack([np.ones_like(numbers), numbers])
    line, squares, _, _ = np.linalg.lstsq(design[others], values[others])
    apart = design[place] @ np.linalg.inv(design[others].T @ design[others]) @ design[place]
    freedom = len(others) - 2
    deviation = np.sqrt(squares[0] / freedom * (1.0 + apart))
    return float(design[place] @ line + deviation * stats.t.ppf(1.0 - chance / 2, freedom))


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "flights"), [(0, 40), (40, 30), (100, 25)])
def test_growth_is_certain_before_its_limit_whenever_it_begins(begin: int, flights: int) -> None:
    """Ten flights before it crosses the limit; the growth may be as old as the aircraft or late."""
    slope = (LIMIT - LEVEL) / flights
    found = [course(*history(seed, begin + flights - 10, slope, begin=begin)) for seed in range(40)]
    assert sum(one.grows for one in found) >= 38
    inside = [one.flights_left(LIMIT) for one in found if one.grows]
    assert np.mean([low <= 10 <= high for low, _, high in inside]) >= 0.85
    assert np.median([one.since for one in found]) == pytest.approx(begin, abs=6)


@pytest.mark.slow
@pytest.mark.parametrize("scatter", [0.03, 0.1])
def test_no_growth_is_found_at_any_of_many_looks(scatter: float) -> None:
    for seed in range(3):
        numbers, values, errors = history(1000 + seed, 120, scatter=scatter)
        looks = [course_of(numbers[:n], values[:n], errors[:n]) for n in range(TREND_FLIGHTS, 121, 4)]
        assert not any(look is not None and look.grows for look in looks)


@pytest.mark.parametrize(("seed", "widened"), [(7, True), (3, False)])
def test_the_evidence_is_the_bayes_factor_of_a_slope(seed: int, widened: bool) -> None:
    """Integrated by hand over the slope, for one beginning: level and scatter have the right Haar prior.

    Neighbours that are alike count for less.
    """
    numbers, values, errors = history(seed, 8, 0.002)
    found = course(numbers, values, errors)._courses
    inflation = widening(found.residuals)
    assert (inflation > 1.01) == widened
    centred = numbers - numbers.mean()
    total = np.sum((values - values.mean()) ** 2)
    slopes, step = np.linspace(-60, 60, 240_001, retstep=True)  # in standard deviations of a flight
    expected = []
    for scale in (0.03, 0.1, 0.4, 1.6):
        share = np.sum(centred**2) / (np.sum(centred**2) + scale**-2)
        rest = total - share * np.sum(centred * values) ** 2 / np.sum(centred**2)
        error = np.sqrt(rest / 7 / (np.sum(centred**2) + scale**-2))
        middle = share * np.sum(centred * values) / np.sum(centred**2)
        rising = 2 * np.sum(stats.t.pdf(slopes[slopes > 0], 7, middle / error)) * step
        expected.append((np.sqrt(1 - share) * (total / rest) ** 3.5) ** (1 / inflation) * rising)
    assert np.exp(found.log_odds()[0]) == pytest.approx(0.5 * np.mean(expected), rel=1e-3)
    assert found.first.tolist() == [0, *range(1, 3)]


@pytest.mark.parametrize("begin", [TREND_FLIGHTS - 1, TREND_FLIGHTS, 12])
def test_of_the_flights_before_a_step_the_scatter_counts_if_there_are_enough(begin: int) -> None:
    numbers, values, errors = history(12, begin + TREND_FLIGHTS, 0.001, scatter=0.01)
    values[:begin] += 0.1 + 0.02 * np.cos(2.4 * numbers[:begin])
    assert course_of(numbers[:-1], values[:-1], errors[:-1], begin=begin) is None
    found = course(numbers, values, errors, begin)
    alone = course(numbers[begin:], values[begin:], errors[begin:])
    freedom, squares = 6.0, alone._courses.variance / widening(alone._courses.residuals) * 6.0
    if begin >= TREND_FLIGHTS:
        before = course(numbers[:begin], values[:begin], errors[:begin])._courses
        freedom += before.freedom
        squares = squares + before.variance[np.argmax(before.log_odds())] * before.freedom
    assert found._courses.freedom == freedom
    assert found._courses.variance / widening(found._courses.residuals) == pytest.approx(squares / freedom)
    assert found.since == begin + alone.since


@pytest.mark.parametrize(("share", "left_out"), [(0.97, True), (1.03, False)])
def test_a_flight_is_left_out_that_chance_hardly_puts_so_far_off(share: float, left_out: bool) -> None:
    """It is compared with the line of the others, and may be any of them, to either side."""
    n, place = 20, 8
    numbers = np.arange(1.0, n + 1)
    # Neighbours alternate about a line that grows from the first flight on.
    values = LEVEL + 0.01 * numbers + 0.004 * (-1.0) ** np.arange(n) * (1.0 + 0.2 * np.cos(numbers))
    values[place] = beside_the_line(numbers, values, place, share * 0.01 / n)
    found = course(numbers, values, np.full(n, 0.002))
    assert found.left_out == ((place,) if left_out else ())


@pytest.mark.parametrize(
    ("place", "before", "after", "differ"),
    [(4, 4, 5, 0.0), (6, 5, 5, 0.0), (8, 5, 4, 0.0), (9, 5, 3, 0.0), (6, 5, 5, 0.002)],
)
def test_a_step_is_larger_than_7_standard_errors(place: int, before: int, after: int, differ: float) -> None:
    """Of means over up to five flights, by what neighbours differ in or by the errors of measurement."""
    at = np.arange(12)
    noise = differ / 2 * (-1.0) ** at
    deviation = differ * 1.4826 / np.sqrt(2.0) if differ else 0.003
    errors = np.full(12, 1e-6 if differ else deviation)
    size = 7.0 * deviation * np.sqrt(1 / before + 1 / after)
    size -= noise[place : place + after].mean() - noise[place - before : place].mean()
    for share, found in ((0.99, None), (1.01, place)):
        assert last_step(LEVEL + noise + share * size * (at >= place), errors) == found


def test_the_interval_is_that_of_all_courses_together() -> None:
    """The slope of a mixture of Student's t, whose quantiles are sought anew."""
    found = course(*history(6, 20, 0.01, begin=8))
    some, shown = found._courses, found.per_flight
    weights = np.exp(some.log_odds()) / np.exp(some.log_odds()).sum()
    assert weights.max() < 0.5
    errors = np.sqrt(some.variance / some.spread)
    for value, share in ((shown.low, 0.025), (shown.high, 0.975)):
        below = stats.t.cdf((value - some.slope) / errors, some.freedom)
        assert float(weights @ below) == pytest.approx(share, abs=1e-6)
    assert shown.estimate == pytest.approx(float(weights @ some.slope))


def test_the_flights_left_are_those_until_the_line_of_all_courses_is_at_the_limit() -> None:
    found = course(*history(6, 20, 0.01, begin=8))
    some, left = found._courses, found.flights_left(LIMIT)
    weights = np.exp(some.log_odds()) / np.exp(some.log_odds()).sum()
    for flights, share in zip(left, (0.025, 0.5, 0.975), strict=True):
        error = np.sqrt(some.variance * (1 / some.total_weight + (some.ahead + flights) ** 2 / some.spread))
        over = stats.t.cdf((some.level + some.slope * flights - LIMIT) / error, some.freedom)
        assert float(weights @ over) == pytest.approx(share, abs=1e-6)


def test_of_equal_errors_the_line_is_that_of_plain_least_squares() -> None:
    numbers, values, errors = history(7, 25, 0.006, scatter=0.035)
    line, plain = course(numbers, values, errors).line, stats.linregress(numbers, values)
    half = stats.t.ppf(0.975, 23) * plain.stderr
    assert line.per_flight.estimate == pytest.approx(plain.slope)
    assert line.per_flight.low == pytest.approx(plain.slope - half)
    assert line.level.estimate == pytest.approx(plain.intercept + plain.slope * 25)
    scatter = np.std(values - plain.intercept - plain.slope * numbers) * np.sqrt(25 / 23)
    at_last = scatter * np.sqrt(1 / 25 + 12**2 / (25 * np.var(numbers)))
    assert line.level.high - line.level.estimate == pytest.approx(stats.t.ppf(0.975, 23) * at_last)
    assert np.hypot(line.between, 0.002) == pytest.approx(scatter, rel=1e-4)


def test_a_flight_that_is_known_badly_counts_little() -> None:
    numbers = np.arange(20.0)
    values, errors = 0.225 + 0.01 * numbers + 0.001 * np.cos(numbers * 2.4), np.full(20, 0.002)
    values[10] += 0.05
    errors[10] = 0.05
    found = course(numbers, values, errors)
    assert found.left_out == ()
    assert found.line.per_flight.estimate == pytest.approx(0.01, abs=2e-4)
    assert found.line.between == pytest.approx(0, abs=1e-3)


def test_growth_is_said_of_one_indicator_in_2500_that_does_not_grow() -> None:
    """It takes a Bayes factor of as many."""
    found = [course(*history(11, 20, slope)) for slope in np.linspace(0.001, 0.006, 200)]
    near = [one for one in found if abs(one.evidence - np.log(2500.0)) < 0.3]
    assert {one.grows for one in near} == {False, True}
    assert all(one.grows == (one.evidence >= np.log(2500.0)) for one in near)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_neighbours_that_are_alike_widen_the_line(unit: float) -> None:
    """By (1 + r)/(1 − r) of their autocorrelation r, up to a limit; those that alternate do not narrow it."""
    assert widening(unit * np.array([1.0, 1.0, -1.0, -1.0, 1.0])) == pytest.approx(1.0)
    assert widening(unit * np.array([1.0, 1.0, 1.0, -1.0, -1.0])) == pytest.approx(1.4 / 0.6)
    assert widening(np.full(50, unit)) == pytest.approx(9.0)
    assert widening(unit * np.array([1.0, -1.0, 1.0, -1.0])) == 1.0
    assert widening(np.zeros(5)) == 1.0


@pytest.mark.parametrize(("flights", "count"), [(TREND_FLIGHTS, 1), (19, 1), (20, 2), (29, 2), (30, 3)])
def test_one_flight_in_ten_may_be_left_out_and_one_of_any_number(flights: int, count: int) -> None:
    """Three are off, each ten times as far as the next: the farthest go."""
    numbers, values, errors = history(4, flights)
    places = [3, 1, 2]
    values[places] += [1000.0, -100.0, 10.0]
    assert course(numbers, values, errors).left_out == tuple(sorted(places[:count]))


def test_a_repair_that_nobody_recorded_is_a_step_and_the_same_wear_is_found_again() -> None:
    numbers, values, errors = history(6, 70, 0.006)
    values[45:] -= 0.006 * 45
    place = last_step(values, errors)
    assert place == 45
    assert course(numbers, values, errors, begin=45).grows
    assert last_step(*history(7, 70, 0.006)[1:]) is None
    assert last_step(*history(8, 70, 0.02, begin=60)[1:]) is None


@pytest.mark.parametrize("change", [-0.2, 0.2])
def test_a_step_has_enough_flights_before_and_after_it(change: float) -> None:
    flights = 14
    scattered = LEVEL + 0.004 * np.sin(2.4 * np.arange(flights))
    for place in range(1, flights):
        values = scattered + change * (np.arange(flights) >= place)
        known = TREND_FLIGHTS // 2 <= place <= flights - 3
        assert last_step(values, np.full(flights, 0.002)) == (place if known else None)
    stepped = np.where(np.arange(flights) >= TREND_FLIGHTS // 2, LEVEL + change, LEVEL)
    for count in range(flights):
        known = count >= max(TREND_FLIGHTS, TREND_FLIGHTS // 2 + 3)
        assert (last_step(stepped[:count], np.full(count, 0.002)) is not None) == known


def test_of_several_steps_the_last_one_counts() -> None:
    at = np.arange(40.0)
    values: Array = LEVEL + 0.2 * (at >= 12.0) - 0.15 * (at >= 25.0) + 0.004 * np.sin(2.4 * at)
    assert last_step(values, np.full(40, 0.002)) == 25
    assert last_step(values[:25], np.full(25, 0.002)) == 12


@pytest.mark.slow
@given(
    st.lists(st.floats(-1e9, 1e9), min_size=TREND_FLIGHTS, max_size=20),
    st.lists(st.floats(0, 1e9), min_size=20, max_size=20),
    st.floats(-1e9, 1e9),
)
def test_any_numbers_have_ordered_flights_left(
    values: list[float], errors: list[float], limit: float
) -> None:
    n = len(values)
    found = course(np.arange(1.0, n + 1), np.array(values), np.array(errors[:n]))
    low, middle, high = found.flights_left(limit)
    assert 0 <= low <= middle <= high
    assert np.isfinite(found.per_flight.estimate)
    assert found.line.level.low <= found.line.level.high
    last_step(np.array(values), np.array(errors[:n]))


@pytest.mark.parametrize("value", [0.0, 0.2, -3e5])
def test_flights_that_agree_to_the_last_digit_do_not_grow(value: float) -> None:
    for n in (TREND_FLIGHTS, 60):
        found = course(np.arange(1.0, n + 1), np.full(n, value), np.full(n, 0.002))
        assert not found.grows
        assert found.per_flight.estimate == pytest.approx(0.0, abs=1e-3)
        assert last_step(np.full(n, value), np.full(n, 0.002)) is None


@pytest.mark.parametrize("pattern", ["alike", "alternating"])
def test_rounding_of_an_exact_line_changes_no_evidence(pattern: str) -> None:
    """Processors round a sum differently; residuals of that size say nothing of how flights are alike."""
    flights, errors = np.arange(12.0), np.full(12, 0.002)
    rounding = 1e-15 * ((flights - 5.5) ** 2 if pattern == "alike" else (-1.0) ** flights)
    exact = course(flights, 0.2 + 0.01 * flights, errors)
    rounded = course(flights, 0.2 + 0.01 * flights + rounding, errors)
    assert rounded.grows
    assert rounded.evidence == pytest.approx(exact.evidence, rel=1e-6)
