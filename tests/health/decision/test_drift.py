"""The actuator's own baseline, and the drift from it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from mavhums.core.statistics import NORMAL_95
from mavhums.health.decision.baseline import Baseline, ComparedIndicator, Drift, Shift
from mavhums.health.decision.growth import course_of
from mavhums.results.verdict import Indicator, Interval
from tests.present import present

BASELINE = Baseline(mean=0.22, error=0.001, flights=12, between=0.003, spread=0.004)
ERROR = 0.008
Array = NDArray[np.float64]


def indicator(value: float, windows: int, scatter: float | None) -> Indicator:
    interval = Interval(estimate=value, low=value - 0.01, high=value + 0.01)
    return Indicator(
        fault="friction",
        quantity="Coulomb friction",
        unit="N·m",
        value=interval,
        windows=windows,
        scatter=scatter,
    )


def follow(
    values: Array, baseline: Baseline = BASELINE, **options: bool | float
) -> tuple[Drift, list[Shift]]:
    drift = Drift(baseline, **options)  # type: ignore[arg-type]
    return drift, [drift.feed(float(v), ERROR, 9.0, 10.0 * k) for k, v in enumerate(values)]


def test_flights_known_alike_count_alike() -> None:
    values = [0.20, 0.22, 0.27] * 4
    baseline = present(Baseline.of([indicator(value, 11, 0.011) for value in values]))
    assert baseline.mean == pytest.approx(0.23)
    of_flight = 0.011**2 / 11 * 10 / 8
    assert baseline.between == pytest.approx(np.sqrt(np.var(values, ddof=1) - of_flight))
    assert baseline.error == pytest.approx(np.std(values, ddof=1) / np.sqrt(12))
    assert baseline.flights == 12
    assert baseline.flight_variance == pytest.approx(baseline.between**2 + baseline.error**2)


def test_a_flight_that_tells_little_counts_little() -> None:
    good = [indicator(value, 9, 0.003) for value in (0.218, 0.220, 0.222) * 4]
    poor = [indicator(value, 9, 0.15) for value in (0.26, 0.18, 0.22) * 4]
    alone, together = present(Baseline.of(good)), present(Baseline.of([*good, *poor]))
    assert together.mean == pytest.approx(alone.mean, abs=0.001)
    assert together.flight_variance < 1.5 * alone.flight_variance
    assert together.spread > 5 * alone.spread


def test_fewer_than_ten_flights_that_show_their_scatter_are_no_baseline() -> None:
    assert Baseline.of([]) is None
    assert Baseline.of([indicator(0.2, 5, 0.01)] * 9) is None
    assert Baseline.of([*[indicator(0.2, 5, 0.01)] * 9, indicator(0.2, 1, None)]) is None
    assert Baseline.of([*[indicator(0.2, 5, 0.01)] * 9, indicator(0.2, 1, 0.01)]) is None
    assert Baseline.of([indicator(0.2, 2, 0.01)] * 10) is not None


@pytest.mark.parametrize(
    ("fault", "grows"),
    [("friction", 1.0), ("friction", -1.0), ("effectiveness", 1.0), ("effectiveness", -1.0)],
)
def test_the_baseline_of_flights_that_wear_is_the_level_before(fault: str, grows: float) -> None:
    """Friction rises with wear and effectiveness falls; the other way is no wear, and the mean counts."""
    at = np.arange(30.0)
    values = 1.0 + grows * 0.02 * np.maximum(at - 15.0, 0.0) + 0.003 * np.sin(2.4 * at)
    wears = grows * (-1.0 if fault == "effectiveness" else 1.0) > 0.0
    shown = [indicator(v, 9, 1e-6).model_copy(update={"fault": fault}) for v in values.tolist()]
    baseline = Baseline.of(shown)
    course = course_of(at, grows * values, np.full(30, 1e-6))
    assert baseline is not None
    assert course is not None
    design = np.ones((30, 1))
    if wears:
        design = np.column_stack([design, np.maximum(at - course.since, 0.0)])
    line = np.linalg.lstsq(design, values)[0]
    left = values - design @ line
    assert baseline.mean == pytest.approx(line[0], rel=1e-3)
    assert baseline.spread == pytest.approx(np.sqrt(left @ left / (30 - design.shape[1])), rel=0.01)
    if wears:
        assert baseline.mean == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("windows", "freedom"), [(13, 12), (2, 1), (1, 1)])
def test_an_indicator_is_compared_by_the_errors_of_both(windows: int, freedom: int) -> None:
    """Its own from its interval, and another flight's from the baseline; freedom by Satterthwaite's rule."""
    compared = ComparedIndicator.of(indicator(0.242, windows, 0.01), BASELINE)
    own, flight = (0.01 / NORMAL_95) ** 2, 0.003**2 + 0.001**2
    error = (own + flight) ** 0.5
    expected = error**4 / (own**2 / freedom + flight**2 / 11)
    assert (compared.difference, compared.error) == pytest.approx((0.022, error))
    assert (compared.ratio, compared.freedom) == pytest.approx((0.022 / error, expected))
    half = stats.t.ppf(0.975, expected) * error / 0.22
    share = compared.share
    assert (share.low, share.estimate, share.high) == (round(1.1 - half, 3), 1.1, round(1.1 + half, 3))


def test_the_prediction_is_a_students_interval() -> None:
    interval = BASELINE.prediction()
    half = stats.t.ppf(0.975, 11) * 0.004 * np.sqrt(1 + 1 / 12)
    assert (interval.low, interval.estimate, interval.high) == pytest.approx((0.22 - half, 0.22, 0.22 + half))


def test_flights_without_any_scatter_make_a_baseline() -> None:
    baseline = present(Baseline.of([indicator(0.2, 9, 0.0)] * 10))
    natural = 0.05 * 0.2 * np.sqrt(9 / 18)
    assert (baseline.mean, baseline.between) == pytest.approx((0.2, natural))


WELL_KNOWN = Baseline(mean=0.22, error=0.0001, flights=200, between=0.0001, spread=0.0025)


@pytest.mark.parametrize(("two_sided", "sign"), [(False, 1.0), (True, 1.0), (True, -1.0)])
def test_the_power_curve_of_a_shift(two_sided: bool, sign: float) -> None:
    """The larger, the sooner, from about one deviation of a window on, with its size and its beginning."""
    delays = []
    for size in (0.0, 0.001, 0.009, 0.02, 0.03, 0.1):
        values = np.append(np.full(40, 0.22), np.full(40, 0.22 + sign * size))
        drift, shifts = follow(values, WELL_KNOWN, two_sided=two_sided)
        alarms = [k for k, shift in enumerate(shifts) if shift.ratio >= 1.0]
        delays.append(alarms[0] - 40 if alarms else 99)
        assert drift.alarm == (shifts[alarms[0]] if alarms else None)
        if drift.alarm:
            assert drift.alarm.since_s == pytest.approx(400.0, abs=100.0)
            assert drift.alarm.value == pytest.approx(sign * size, abs=0.01)
    assert delays == sorted(delays, reverse=True)
    assert delays[:2] == [99, 99]
    assert 8 < delays[2] < 34
    assert delays[-1] == 0


def test_a_fall_is_no_wear_and_a_rarer_alarm_and_two_sides_take_more_evidence() -> None:
    assert follow(np.full(20, 0.17))[0].alarm is None
    values = np.full(5, 0.25)
    one, both, seldom = (
        shifts[-1].ratio
        for _, shifts in (follow(values), follow(values, two_sided=True), follow(values, false_alarms=0.01))
    )
    assert 0.9 * one < both < one
    assert seldom < both


def test_a_window_that_doubts_itself_alarms_nobody() -> None:
    drift = Drift(WELL_KNOWN)
    for k in range(30):
        drift.feed(0.22, ERROR, 9.0, 10.0 * k)
    assert drift.feed(0.42, 0.2, 9.0, 300.0).ratio < 1.0
    assert drift.feed(0.42, ERROR, 9.0, 310.0).ratio > 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("heavy", "unlike"), [(False, False), (True, True)])
def test_false_alarms_are_as_rare_as_promised(heavy: bool, unlike: bool) -> None:
    """Healthy flights of 100 s whose windows have Student's t4 or normal scatter; baselines of ten flights.

    Where they are ``unlike``, some are ten times as noisy as others. The rate is asked for 1000 times as
    high, so that it can be counted: 1000 alarms in 100 h, that is one in 36 windows.
    """
    rng = np.random.default_rng(4)
    between, flights, rate = 0.011, 10, 1000.0
    alarms = windows = 0
    for _ in range(300):
        within = 0.008 * 10 ** (rng.uniform(-0.5, 0.5, flights + 1) if unlike else np.zeros(flights + 1))
        past = np.full((flights, 10), 0.22) + between * rng.standard_normal((flights, 1))
        past += within[1:, None] * scatter(rng, (flights, 10), heavy)
        known = present(Baseline.of([indicator(float(f.mean()), 10, float(f.std(ddof=1))) for f in past]))
        now = 0.22 + between * rng.standard_normal() + within[0] * scatter(rng, (10,), heavy)
        drift = Drift(known, false_alarms=rate)
        for k, value in enumerate(now):
            drift.feed(float(value), within[0], 9.0, 10.0 * k)
        drift.conclude(float(now.mean()), within[0], 9.0, 0.0)
        alarms += drift.alarm is not None
        windows += 10
    promised = rate / 36_000 * windows
    assert alarms <= promised + 3 * np.sqrt(promised)
    assert alarms >= 0.05 * promised


def test_the_whole_flight_shows_what_no_run_of_windows_does() -> None:
    values = np.full(20, 0.22 + 0.018)
    drift, shifts = follow(values)
    assert drift.alarm is None
    known_worse = drift.conclude(0.238, 0.1, 30.0, 0.0)
    assert known_worse.error < 0.01
    assert drift.alarm == known_worse
    assert drift.alarm.since_s == 0.0
    assert max(shift.ratio for shift in shifts) < 1.0


def scatter(rng: np.random.Generator, shape: tuple[int, ...], heavy: bool) -> Array:
    return rng.standard_t(4, shape) / np.sqrt(2.0) if heavy else rng.standard_normal(shape)


@pytest.mark.parametrize("two_sided", [False, True])
def test_a_whole_flight_is_one_look_at_the_rate_allowed(two_sided: bool) -> None:
    """With 3,600 alarms in the 36,000 windows of 100 h, half of them at the end, one flight in twenty."""
    rng = np.random.default_rng(8)
    alarms, count = 0, 4000
    for _ in range(count):
        flights = BASELINE.mean + 0.003 * rng.standard_normal(BASELINE.flights)
        between = float(flights.std(ddof=1))
        error = between / np.sqrt(BASELINE.flights)
        own = Baseline(float(flights.mean()), error, BASELINE.flights, between, spread=between)
        drift = Drift(own, two_sided=two_sided, false_alarms=3600.0)
        drift.conclude(BASELINE.mean + 0.003 * rng.standard_normal(), 1e-6, 30.0, 0.0)
        alarms += drift.alarm is not None
    assert alarms / count == pytest.approx(0.05, abs=0.015)
