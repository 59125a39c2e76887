"""One flight against the flights before: analytic error, degrees of freedom and share, and what counts."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest
from scipy.stats import t

from mavhums.core.conditions import Condition
from mavhums.health.axis.past import _departures, compare_with_earlier_flights
from mavhums.health.decision.baseline import Baseline, ComparedIndicator
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Coverage, Evidence, Indicator, Suspect, Verdict
from tests.health import builders
from tests.present import present

START = datetime(2026, 3, 1, 9, tzinfo=UTC)
LIMITS = AxisLimits(effectiveness_degraded=0.8, effectiveness_emergency=0.5, lag_s=0.25, trim_shift=0.1)


def indicator(fault: str, value: float, error: float = 0.01, quantity: str = "control gain") -> Indicator:
    return builders.indicator(fault, value, 1.96 * error, quantity=quantity, windows=45)


def compared(fault: str, value: float, mean: float, ratio: float, quantity: str = "") -> ComparedIndicator:
    """Return a difference that is so many of its standard errors, with 8 degrees of freedom."""
    baseline = Baseline(mean=mean, error=0.01, flights=9, between=0.0, spread=0.01)
    error = abs((value - mean) / ratio)
    return ComparedIndicator(indicator(fault, value, quantity=quantity), baseline, value - mean, error, 8.0)


TAIL = 0.001
CERTAIN = float(t.ppf(1.0 - TAIL, 8.0))


@pytest.mark.parametrize(
    ("fault", "value", "mean", "condition", "rule"),
    [
        ("effectiveness", 1.58, 2.0, "degraded", "degraded: 79 % of the control effectiveness of 9 earlier"),
        ("effectiveness", 1.0, 2.0, "emergency", "emergency: 50 % of the control effectiveness"),
        ("effectiveness", 1.02, 2.0, "degraded", "degraded: 51 %"),
        ("effectiveness", -0.2, 2.0, "emergency", "emergency: 0 %"),
        ("effectiveness", 1.6, 2.0, None, ""),
        ("effectiveness", -2.0, -1.0, None, ""),
        ("manoeuvre", 1.0, 2.0, "emergency", "emergency: 50 % of the load factor of 9"),
        ("slow", 0.55, 0.25, "degraded", "degraded: answers 0.3 s later than in 9 earlier flights"),
        ("slow", 0.5, 0.25, "degraded", "degraded: answers 0.2 s later"),
        ("slow", 0.49, 0.25, None, ""),
        ("slow", 0.1, 0.5, None, ""),
        ("hard_over", 0.25, 0.125, "degraded", "degraded: needs 12 % of the full demand more to the ri"),
        ("hard_over", -0.125, 0.0, "degraded", "degraded: needs 12 % of the full demand more to the le"),
        ("hard_over", 0.09, 0.0, None, ""),
        ("other", 9.0, 0.0, None, ""),
    ],
)
def test_a_difference_counts_beyond_the_limit_if_it_is_certain(
    fault: str, value: float, mean: float, condition: Condition | None, rule: str
) -> None:
    sign = 1.0 if value > mean else -1.0
    for ratio, is_certain in ((1.001 * CERTAIN, True), (0.999 * CERTAIN, False)):
        one = compared(fault, value, mean, sign * ratio, "load factor")
        found = [*_departures([one], LIMITS, TAIL)]
        assert [each.condition for each in found] == ([condition] if condition and is_certain else [])
        for each in found:
            assert each.rule.startswith(rule)
            assert each.fault == ("effectiveness" if fault == "manoeuvre" else fault)
            assert each.confidence == 0.99
            assert each.limit == {
                "slow": 0.25, "hard_over": 0.1,
            }.get(fault, 0.5 if condition == "emergency" else 0.8)  # fmt: skip


def test_the_gain_and_the_load_factor_are_one_loss() -> None:
    both = [compared("effectiveness", 1.5, 2.0, -50.0), compared("manoeuvre", 1.0, 2.0, -20.0)]
    for order in (both, both[::-1]):
        [found] = _departures(order, LIMITS, TAIL)
        assert (found.value, found.condition, found.confidence) == (0.5, "emergency", 0.99)


def verdict(condition: Condition = "normal", *, windows: int = 300, **changes: Any) -> Verdict:
    seen = Coverage(windows=windows, decidable=200, moving_fraction=0.5)
    reasons = {"reason": "as it was", "remedy": "fly"}
    return builders.verdict(condition, subject="axis", limits=LIMITS, coverage=seen, **reasons, **changes)


def earlier(mean: float) -> Baseline:
    return Baseline(mean=mean, error=0.01, flights=9, between=0.02, spread=0.03)


def judged(one: Verdict, baselines: dict[str, Baseline], **how: float) -> Verdict:
    return compare_with_earlier_flights(one, baselines, start_utc=START, end_s=400.0, **how)


def test_what_is_as_before_is_normal_without_a_reservation() -> None:
    as_before = (indicator("effectiveness", 2.0), indicator("slow", 0.3))
    found = judged(verdict(indicators=as_before), {"effectiveness": earlier(2.0)})
    assert (found.condition, found.reason, found.remedy) == ("normal", None, None)
    assert [one.baseline_flights for one in found.indicators] == [9, None]
    expected = earlier(2.0).prediction()
    assert present(found.indicators[0].baseline).high == pytest.approx(expected.high, rel=1e-4)
    undecided = judged(verdict("undecided", indicators=as_before), {"effectiveness": earlier(2.0)})
    assert undecided.reason == "as it was"
    assert judged(verdict(indicators=as_before), {"hard_over": earlier(0.0)}).reason == "as it was"


@pytest.mark.parametrize(
    ("before", "value", "condition", "worst", "since"),
    [
        ("normal", 1.5, "degraded", "degraded", True),
        ("undecided", 1.5, "degraded", "degraded", True),
        ("degraded", 1.5, "degraded", "degraded", True),
        ("emergency", 1.5, "emergency", "emergency", False),
        ("degraded", 0.9, "emergency", "emergency", True),
    ],
)
def test_a_departure_holds_from_the_start_on_unless_the_flight_shows_worse(
    before: Condition, value: float, condition: Condition, worst: Condition, since: bool
) -> None:
    suspect = Suspect(fault="tracking", confidence=0.9)
    one = verdict(before, indicators=(indicator("effectiveness", value),), suspects=(suspect,))
    found = judged(one, {"effectiveness": earlier(2.0)})
    assert (found.condition, found.worst) == (condition, worst)
    assert [each.fault for each in found.suspects] == ["effectiveness", "tracking"]
    [evidence] = found.evidence
    assert (evidence.kind, evidence.start_s, evidence.end_s) == ("effectiveness", 0.0, 400.0)
    assert evidence.value == value / 2.0
    assert evidence.rule.endswith("flights is left, from the start on")
    assert (found.since is not None) is since
    assert (found.reason is None) is since
    if found.since:
        assert (found.since.flight_time_s, found.since.utc) == (0.0, START.isoformat())
    assert present(found.effectiveness).estimate == value / 2.0


def test_what_the_flight_shows_itself_keeps_its_onset() -> None:
    shown = Evidence(kind="effectiveness", start_s=50.0, end_s=60.0, value=0.5, limit=0.8, rule="lost")
    one = verdict("degraded", indicators=(indicator("effectiveness", 1.5),), evidence=(shown,))
    found = judged(one, {"effectiveness": earlier(2.0)})
    assert (found.evidence, found.reason) == ((shown,), "as it was")


def test_a_longer_flight_may_use_more_of_the_allowed_false_alarms() -> None:
    """At one in 100 hours a window of 10 s has 1/36,000, a flight of 300 s 30 times that, for four tests."""
    before = Baseline(mean=0.3, error=0.05, flights=9, between=0.1, spread=0.1)
    freedom = ComparedIndicator.of(indicator("slow", 0.6), before).freedom
    error = (0.01**2 + 0.1**2 + 0.05**2) ** 0.5
    for seconds in (300, 5):
        bound = float(t.ppf(1.0 - max(seconds, 10) / 10 / 36_000 / 4, freedom)) * error
        for beyond, condition in ((1.01, "degraded"), (0.99, "normal")):
            shown = indicator("slow", 0.3 + beyond * bound)
            one = verdict(indicators=(shown,), windows=seconds)
            assert judged(one, {"slow": before}, false_alarms=1.0).condition == condition
