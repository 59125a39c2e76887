"""An actuator's state over its flights: a limit that was crossed, growth, and unrecorded repairs."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
import pytest

from mavhums.core.conditions import Condition
from mavhums.flights.aircraft import Since as Dates
from mavhums.flights.history import PastFlight
from mavhums.flights.reports import _kinds
from mavhums.flights.trends import standings_after, trend_report
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.growth import course_of
from mavhums.results.assessment import Assessment
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Change, Standing
from mavhums.results.verdict import ALL, Since
from mavhums.show.headline import headline
from mavhums.show.standing import _change_lines
from tests.flights import START, flown, shown, verdict
from tests.present import present


def history(values: list[float], *, scatter: float = 0.0, alone: float = 0.02) -> list[PastFlight]:
    return [*map(PastFlight.of, assessments(values, scatter=scatter, alone=alone))]


def assessments(values: list[float], *, scatter: float = 0.0, alone: float = 0.02) -> list[Assessment]:
    """Flights of an elevator; each alone is degraded only where it lies far above the limit."""
    seen = np.asarray(values) + scatter * np.random.default_rng(len(values)).standard_normal(len(values))
    conditions: list[Condition] = ["degraded" if one > 0.375 + alone else "normal" for one in seen]
    judged = [verdict(shown(at), condition=said) for at, said in zip(seen.tolist(), conditions, strict=True)]
    return [flown(one, day=day) for day, one in enumerate(judged)]


def standing(values: list[float], **given: float) -> Standing:
    (one,) = trend_report(history(values, **given)).standings
    return one


def test_a_limit_that_was_crossed_stays_crossed_until_five_flights_say_otherwise() -> None:
    one = standing([0.2, 0.42, 0.36, 0.42, 0.36, 0.36])
    assert (one.condition, one.last, one.since_flight, one.clear_flights) == ("degraded", "normal", 2, 2)
    assert (one.quantity, one.limit) == ("Coulomb friction", 0.375)
    assert present(one.value).estimate == pytest.approx(0.42)
    cleared = standing([0.2, 0.42, *[0.36] * 5])
    assert (cleared.condition, cleared.since_flight) == ("normal", None)


def test_an_interval_above_the_limit_is_enough_for_the_state() -> None:
    one = standing([0.2, 0.2, 0.385])  # 0.381 to 0.389, and normal as a flight alone
    assert (one.last, one.condition, one.since_flight) == ("normal", "degraded", 3)


def test_flights_that_could_not_be_judged_end_nothing() -> None:
    blind = (PastFlight.of(flown(verdict(condition="undecided"), day=day)) for day in range(2, 9))
    (one,) = trend_report([*history([0.2, 0.42]), *blind]).standings
    assert (one.condition, one.last, one.clear_flights) == ("degraded", "undecided", 0)


def test_a_repair_ends_the_state_recorded_or_not() -> None:
    worn = [0.45] * 12
    mended = [*worn, 0.21, 0.22, 0.21]
    unrecorded = standing(mended, scatter=0.004)
    step = present(unrecorded.step)
    assert (unrecorded.condition, step.flight, step.better) == ("normal", 13, True)
    recorded = trend_report(history(mended[:13]), repaired={"elevator": START + timedelta(days=11.5)})
    assert recorded.standings[0].condition == "normal"
    assert standing(mended[:13], scatter=0.004).condition == "degraded"


def test_what_grows_is_reported_with_the_dates_of_its_limits_before_it_reaches_them() -> None:
    grown = history([0.21 + 0.005 * day for day in range(24)], scatter=0.008)
    one = trend_report(grown).standings[0]
    assert one.condition == "normal"
    left, later = (
        present(limit) for limit in (present(one.growth).to_degraded, present(one.growth).to_emergency)
    )
    assert left.low <= (0.375 - 0.21) / 0.005 - 23 <= (left.high or np.inf)
    assert present(left.expected_utc) > "2026-03-24"
    assert not left.is_far
    assert later.low <= (0.875 - 0.21) / 0.005 - 23 <= (later.high or np.inf)
    assert later.is_far, "110 flights ahead are more than three times the 23 that it looks back"
    assert one.is_finding


def test_trends_come_worst_first_then_soonest_then_nearest_to_the_limit() -> None:
    levels = {"b far": 0.2, "a far": 0.2, "near": 0.34, "grows": 0.21, "worn": 0.3}
    flights = []
    for day in range(24):
        several = []
        for name, level in levels.items():
            seen = shown(level + 0.005 * day * (name == "grows") + 0.004 * np.cos(2.4 * day))
            condition: Condition = "degraded" if name == "worn" else "normal"
            several.append(verdict(seen, actuator=name, condition=condition))
        flights.append(PastFlight.of(flown(*several, day=day)))
    names = [one.actuator for one in trend_report(flights).trends]
    assert names == ["worn", "grows", "near", "a far", "b far"]


def test_an_axis_loses_down_to_its_shares_of_the_first_flights() -> None:
    """From 1.0 it falls by 0.01 a flight: the baseline is its level at first, the limits shares of that."""
    limits = AxisLimits(effectiveness_degraded=0.7, effectiveness_emergency=0.5)
    flights = []
    for day in range(24):
        value = 1.0 - 0.01 * day + 0.002 * np.cos(2.4 * day)
        one = shown(value, fault="effectiveness").model_copy(update={"limit": 9.0, "emergency": 8.0})
        roll = verdict(one, actuator="roll").model_copy(update={"subject": "axis", "limits": limits})
        flights.append(PastFlight.of(flown(roll, day=day)))
    [found] = trend_report(flights).trends
    mean = present(found.baseline).estimate
    assert mean == pytest.approx(1.0, abs=0.01)
    assert [found.limit, found.emergency] == pytest.approx([0.7 * mean, 0.5 * mean])
    level, per_flight, grows = present(found.level), present(found.per_flight), present(found.growth)
    assert level.low < 0.77 < level.high < level.low + 0.02
    assert level.estimate == pytest.approx(0.77, abs=0.01)
    assert per_flight.low <= -0.01 <= per_flight.high < 0.0
    assert per_flight.estimate == pytest.approx(-0.01, abs=0.001)
    assert grows.per_flight.low <= grows.per_flight.estimate <= grows.per_flight.high < 0
    for left, limit in ((grows.to_degraded, 0.7), (grows.to_emergency, 0.5)):
        assert present(left).estimate == pytest.approx((0.77 - limit * mean) / 0.01, abs=1.5)
    assert present(found.change).estimate == pytest.approx(-0.23, abs=0.01)
    assert found.points.highest == (None,) * 24
    assert found.points.flight == (*range(1, 25),)


def test_only_verdicts_of_a_vehicles_actuators_since_their_date_are_followed() -> None:
    flights = []
    for day in range(3):
        names = ("elevator", "rudder", ALL)
        several = [verdict(shown(0.2), actuator=name) for name in names]
        several.append(verdict(shown(0.2), actuator="flap", vehicle=None))
        flights.append(PastFlight.of(flown(*several, day=day)))
    cases: tuple[tuple[tuple[str, ...], Dates, dict[str, int]], ...] = (
        ((), {}, {"elevator": 3, "rudder": 3}),
        (("rudder",), {}, {"rudder": 3}),
        ((), {"elevator": START + timedelta(days=1)}, {"elevator": 2, "rudder": 3}),
        ((), {None: START + timedelta(days=2)}, {"elevator": 1, "rudder": 1}),
        ((), {None: START + timedelta(days=3)}, {}),
    )
    for actuators, since, expected in cases:
        report = trend_report(flights, actuators=actuators, since=since)
        assert {one.actuator: one.flights for one in report.trends} == expected
        assert {one.actuator: one.flights for one in report.standings} == expected


@pytest.mark.parametrize(
    ("condition", "listed"),
    [("normal", False), ("undecided", False), ("learning", False), ("degraded", True), ("emergency", True)],
)
def test_a_fault_of_the_last_flight_is_listed_unasked(condition: Condition, listed: bool) -> None:
    flights = [flown(verdict(shown(0.2))), flown(verdict(shown(0.2), condition=condition), day=1)]
    report = trend_report(map(PastFlight.of, flights), faults=["backlash"])
    assert report.trends == ()
    assert [(one.vehicle, one.actuator, one.last) for one in report.others] == [
        (1, "elevator", condition)
    ] * listed


def test_a_flight_and_its_history_never_contradict_each_other() -> None:
    """The last flight alone is normal; the assessment says that it grows, and does not end with 0."""
    several = assessments([0.21 + 0.005 * day for day in range(24)], scatter=0.008)
    flights = [*map(PastFlight.of, several)]
    *before, last = flights
    completed = several[-1].model_copy(update={"standings": standings_after(last, before, None)})
    assert completed.standings[0].growth is not None
    assert completed.exit_code.name == "DEGRADED"
    assert standings_after(last, [], None) == ()
    for at in (0, 12):
        earlier = standings_after(flights[at], flights, None)
        assert [one.flights for one in earlier] == [at + 1] * (at > 0), "later flights do not count"


@pytest.mark.parametrize(
    ("since_s", "said"), [(0.0, "degraded since flight 3 of 5 (2026-03-03)"), (60.0, "degraded since 1m00s")]
)
def test_a_fault_of_an_earlier_flight_is_not_dated_to_this_one(since_s: float, said: str) -> None:
    *earlier, last = assessments([0.2, 0.2, 0.5, 0.5, 0.5])
    [judged] = last.verdicts
    judged = judged.model_copy(update={"since": Since(flight_time_s=since_s, utc=START.isoformat())})
    now = last.model_copy(update={"verdicts": (judged,)})
    states = standings_after(PastFlight.of(now), map(PastFlight.of, earlier), None)
    assert said in headline(now.model_copy(update={"standings": states})).text


def test_the_baseline_is_the_level_before_the_growth() -> None:
    grown = [shown(0.213 + 0.005 * day + 0.004 * np.cos(2.4 * day)) for day in range(20)]
    known = present(Baseline.of(grown))
    assert known.mean == pytest.approx(0.213, abs=0.008)
    prediction = known.prediction()
    assert prediction.high - prediction.low < 0.03


def test_what_grows_on_is_not_gone() -> None:
    grows = standing([0.22 + 0.004 * day for day in range(30)], scatter=0.004)
    assert (grows.condition, grows.growth is not None) == ("normal", True)
    was = grows.model_copy(update={"condition": "degraded"})
    assert [*_kinds(was, grows)] == ["eased"]
    change = Change(kind="eased", aircraft="D-A", before=was, now=grows)
    (line, why) = _change_lines(change)
    assert line == "it was degraded; now growing in flight 30 (2026-03-30)"
    assert "grows by" in why


@pytest.mark.slow
def test_growth_that_was_certain_does_not_go_with_one_flight() -> None:
    """The evidence falls below its threshold and rises again; a list would say "grows", "normal", "grows"."""
    rng = np.random.default_rng(1)
    values = 0.225 + 0.004 * np.arange(40) + 0.0225 * rng.standard_normal(40)
    numbers, errors = np.arange(1.0, 41.0), np.full(40, 0.002)
    certain = [
        (one := course_of(numbers[:n], values[:n], errors[:n])) is not None and one.grows
        for n in range(8, 41)
    ]
    first = certain.index(True)
    assert not all(certain[first:])
    grows = [standing([*values[:n]]).growth is not None for n in range(8, 41)]
    assert grows.index(True) == first
    assert all(grows[first:])
