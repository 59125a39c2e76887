"""The baseline of a quantity over earlier flights, and a flight beside it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mavhums.core.statistics import NORMAL_95
from mavhums.health.decision.baseline import Baseline, ComparedIndicator
from mavhums.health.decision.growth import course_of
from mavhums.health.estimation.random_effects import satterthwaite
from mavhums.results.verdict import Indicator
from tests.health import builders
from tests.present import present

BASELINE = Baseline(mean=0.22, error=0.001, flights=12, between=0.003, spread=0.004)


def indicator(value: float, windows: int, scatter: float | None) -> Indicator:
    return builders.indicator("friction", value, 0.01, windows=windows, scatter=scatter)


def test_flights_known_alike_count_alike() -> None:
    values = [0.20, 0.22, 0.27] * 4
    baseline = present(Baseline.of([indicator(value, 11, 0.011) for value in values]))
    assert baseline.mean == pytest.approx(0.23)
    of_flight = 0.011**2 / 11 * 10 / 8
    assert baseline.between == pytest.approx(np.sqrt(np.var(values, ddof=1) - of_flight))
    assert baseline.error == pytest.approx(np.std(values, ddof=1) / np.sqrt(12))
    assert baseline.flights == 12
    assert baseline.flight_variance == pytest.approx(baseline.between**2 + baseline.error**2)


def test_a_flight_that_shows_little_counts_little() -> None:
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
    baseline = present(Baseline.of(shown))
    course = present(course_of(at, grows * values, np.full(30, 1e-6)))
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


def test_the_mean_of_the_windows_is_compared_where_it_is_known() -> None:
    """The value over the whole flight has errors that all flights share."""
    flights = [
        indicator(9.9, 9, 0.006).model_copy(update={"mean": 0.22 + 0.001 * (k % 3 - 1), "mean_error": 0.002})
        for k in range(12)
    ]
    known = present(Baseline.of(flights))
    assert known.mean == pytest.approx(0.22)
    now = indicator(9.9, 9, 0.006).model_copy(update={"mean": 0.242, "mean_error": 0.0015})
    compared = ComparedIndicator.of(now, known)
    assert compared.difference == pytest.approx(0.022)
    assert compared.error == pytest.approx((0.0015**2 + known.flight_variance) ** 0.5)
    assert compared.times == pytest.approx(1.1)
    grown = now.model_copy(update={"mean_error": 0.1, "scatter": 0.3})
    error = (0.002**2 + known.flight_variance) ** 0.5
    assert ComparedIndicator.of(grown, known).error == pytest.approx(error)
    ten_slots_each = satterthwaite(0.0015**2, 8 * 9, known.flight_variance, known.certainty)
    assert compared.freedom == pytest.approx(ten_slots_each)
