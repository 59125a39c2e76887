"""One indicator of one flight against the flights before: analytic error, degrees of freedom and share."""

from __future__ import annotations

import pytest
from scipy.stats import t

from mavhums.health.axis.past import ComparedIndicator
from mavhums.health.decision.baseline import Baseline
from mavhums.results.standing import Interval
from mavhums.results.verdict import Indicator


def test_the_error_joins_the_interval_of_the_flight_with_the_scatter_between_flights() -> None:
    value = Interval(estimate=1.5, low=1.5 - 0.2 * 1.96, high=1.5 + 0.2 * 1.96)
    indicator = Indicator(fault="effectiveness", quantity="effectiveness", unit="", value=value, windows=5)
    baseline = Baseline(mean=2.0, error=0.03, flights=9, between=0.04, spread=0.1)
    one = ComparedIndicator.of(indicator, baseline)
    own, between = 0.2**2, 0.04**2 + 0.03**2
    assert one.difference == pytest.approx(-0.5)
    assert one.error == pytest.approx((own + between) ** 0.5, rel=1e-4)
    # Welch and Satterthwaite: 4 degrees of freedom of five windows, 8 of nine flights.
    freedom = (own + between) ** 2 / (own**2 / 4 + between**2 / 8)
    assert one.freedom == pytest.approx(freedom, rel=1e-3)
    assert one.ratio == pytest.approx(-0.5 / one.error)
    half = t.ppf(0.975, freedom) * one.error / 2.0
    assert one.share.estimate == 0.75
    assert one.share.low == pytest.approx(0.75 - half, abs=6e-4)
    assert one.share.high == pytest.approx(0.75 + half, abs=6e-4)
