"""Known differences between flights: what they explain, and what lies beyond them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mavhums.health.estimation.equations.own_scale import TWO_WAYS
from mavhums.health.self_baseline.comparison import compare
from mavhums.health.self_baseline.past import compared, differences
from mavhums.results.verdict import OwnRecord
from tests.health.self_baseline.servo import EQUATION, Servo, left, past, scaled
from tests.present import present

BY_ACTIVITY = replace(EQUATION, by_activity=True)
SLOPE = 1.5


def lively(record: OwnRecord, times: float) -> OwnRecord:
    return scaled(record, acceleration=times)


def flown(seed: int, friction_a: float = 0.05) -> OwnRecord:
    """Return a flight whose friction current grows with its accelerations."""
    times = float(np.exp(np.random.default_rng([seed, 3]).uniform(-0.4, 0.4)))
    servo = Servo(inertia=0.0, friction_a=friction_a * (1.0 + SLOPE * float(np.log(times))))
    return lively(left(servo, seed, seconds=60.0), times)


RECORDS = [flown(seed) for seed in range(14)]
PAST = past(*RECORDS)


def test_what_the_activity_explains_is_no_scatter() -> None:
    own = flown(20)
    blind, seeing = compare(EQUATION, own, PAST), compare(BY_ACTIVITY, own, PAST)
    assert blind.condition == seeing.condition == "unchanged"
    least = present(seeing.least_rise)
    assert least < 0.6 * present(blind.least_rise)
    assert compare(BY_ACTIVITY, flown(21, 0.05 * (1.0 + 1.3 * least)), PAST).condition == "changed"


def at(seed: int, times: float, friction_a: float = 0.05) -> OwnRecord:
    """Return a flight of an activity of its own, whose friction current does not grow with it."""
    return lively(left(Servo(inertia=0.0, friction_a=friction_a), seed, seconds=60.0), times)


def test_flights_beyond_the_activity_of_the_others_make_a_baseline_of_their_own() -> None:
    before = [*PAST, *past(*(flown(30 + k) for k in range(6)))]
    for times, word in ((5.0, "rougher"), (0.2, "calmer")):
        first = compare(BY_ACTIVITY, at(40, times), before)
        assert (first.condition, first.flights) == ("learning", 1)
        assert first.why == f"it was {word} than the flights of the first baseline"
        both = [*before, *past(*(at(50 + k, times) for k in range(12)))]
        assert compare(BY_ACTIVITY, at(41, times), both).condition == "unchanged"
        assert compare(BY_ACTIVITY, at(42, times, 0.08), both).condition == "changed"
        assert compare(BY_ACTIVITY, RECORDS[0], both) == compare(BY_ACTIVITY, RECORDS[0], before)
    assert compare(EQUATION, lively(RECORDS[0], 5.0), PAST).condition != "learning"


def test_a_flight_beyond_the_baseline_neither_begins_nor_ends_a_run() -> None:
    before = past(*(at(seed, 1.0 + 0.02 * seed) for seed in range(12)))
    worn = past(at(92, 1.0, 0.08), at(93, 5.0), at(94, 5.0, 0.08), healthy=False)
    found = compare(BY_ACTIVITY, at(95, 1.0, 0.08), [*before, *worn])
    assert found.condition == "changed"
    assert present(found.since).flight == 13


def test_the_activity_is_the_logarithm_of_the_acceleration_where_flights_differ_in_it() -> None:
    record = RECORDS[0]
    [activity] = differences(BY_ACTIVITY, [record, lively(record, 2.0)])
    assert activity.high - activity.low == pytest.approx(np.log(2.0))
    found = [activity.beyond(lively(record, times)) for times in (0.79, 0.81, 2.49, 2.51)]
    assert found == ["calmer", "", "", "rougher"], "a quarter beyond"
    assert differences(BY_ACTIVITY, [record, record]) == []
    [still] = differences(BY_ACTIVITY, [record, lively(record, 0.0)])
    assert still.low == pytest.approx(np.log(1e-6))


def test_the_first_twenty_healthy_flights_are_the_baseline_and_those_after_the_last_are_judged() -> None:
    own = RECORDS[0]
    sick, other, slow, fast = 3, 5, 7, 9
    changes: dict[int, dict[str, Any]] = {
        other: {"setup": "otherwise"},
        slow: {"rate_hz": own.rate_hz / 1.251},
        fast: {"rate_hz": own.rate_hz * 1.25},
        11: {"groups": own.groups[:1]},
    }
    records = past(*(own.model_copy(update=changes.get(k, {})) for k in range(1, 31)))
    records[sick - 1] = records[sick - 1]._replace(healthy=False)
    reference, after = compared(EQUATION, own, records)
    left_out = {sick, other, slow, 11}
    numbers = [k for k in range(1, 31) if k not in left_out]
    assert [number for number, _, _ in reference] == numbers[:20]
    later = [(number, date) for number, date, _ in after]
    assert later == [(k, records[k - 1].date) for k in reversed(numbers[20:])], "the latest first"
    # Until there are twenty, only what comes after the last healthy one is judged.
    unsound = [one._replace(healthy=k in (1, 2)) for k, one in enumerate(records, 1)]
    reference, after = compared(EQUATION, own, unsound)
    assert [number for number, _, _ in reference] == [1, 2]
    assert {number for number, _, _ in after} == {*range(3, 31)} - {other, slow, 11}
    none = [one._replace(healthy=False) for one in records]
    assert len([*compared(EQUATION, own, none)[1]]) == 27


def swept(load: float, strokes: int = 4, *, against: int = 0) -> OwnRecord:
    """Return strokes with a load, ``against`` of them the other way."""
    rows = tuple((1.0, 0.3, load if k >= against else -load) for k in range(strokes))
    return RECORDS[0].model_copy(update={"equation": TWO_WAYS.name, "groups": rows})


def test_a_load_is_fitted_where_the_flights_loads_differ_by_more_than_a_quarter() -> None:
    def loads(*several: float) -> tuple[bool, float]:
        found = differences(TWO_WAYS, [swept(load) for load in several])
        return found[0].fitted, found[0].margin

    assert loads(1.0, 1.25) == (False, 0.05 * 1.25)
    assert loads(1.0, 1.26) == (True, 0.05 * 1.26)


def test_a_direction_of_the_load_is_fitted_where_it_differs_between_the_flights() -> None:
    def direction(*against: int) -> bool:
        found = differences(TWO_WAYS, [swept(1.0, against=each) for each in against])
        return found[1].fitted

    assert [direction(0, 2), direction(0, 3), direction(0, 4)] == [False, True, True]


def test_fewer_strokes_than_in_any_reference_flight_are_beyond_it() -> None:
    shorter = differences(TWO_WAYS, [swept(1.0, 6), swept(1.0, 4)])[-1]
    assert [shorter.beyond(swept(1.0, each)) for each in (3, 4, 99)] == ["shorter in strokes", "", ""]
    assert not shorter.fitted
