"""Known differences between flights: what they explain, and what lies beyond them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations.own_scale import TWO_WAYS
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.least_squares import packed, unpacked
from mavhums.health.self_baseline.comparison import compare
from mavhums.health.self_baseline.past import differences
from mavhums.results.verdict import OwnRecord
from tests.health.self_baseline.servo import EQUATION, Servo, left

BY_ACTIVITY = replace(EQUATION, by_activity=True)
SLOPE = 1.5


def lively(record: OwnRecord, times: float) -> OwnRecord:
    """Return the record of the same flight with its accelerations multiplied."""
    scale = np.ones(len(KEPT))
    scale[KEPT.index("acceleration")] = times
    grams = [(row[0], unpacked(row[1:], len(KEPT)) * np.outer(scale, scale)) for row in record.groups]
    return record.model_copy(update={"groups": tuple((count, *packed(gram)) for count, gram in grams)})


def flown(seed: int, friction_a: float = 0.05) -> OwnRecord:
    """Return a flight whose friction current grows with its accelerations."""
    times = float(np.exp(np.random.default_rng([seed, 3]).uniform(-0.4, 0.4)))
    servo = Servo(inertia=0.0, friction_a=friction_a * (1.0 + SLOPE * float(np.log(times))))
    return lively(left(servo, seed, seconds=60.0), times)


RECORDS = [flown(seed) for seed in range(14)]
PAST = [PastRecord((record,), "2026-03-01", True) for record in RECORDS]


def test_what_the_activity_explains_is_no_scatter() -> None:
    own = flown(20)
    blind, seeing = compare(EQUATION, own, PAST), compare(BY_ACTIVITY, own, PAST)
    assert blind.condition == seeing.condition == "unchanged"
    assert blind.least_rise is not None
    assert seeing.least_rise is not None
    assert seeing.least_rise < 0.6 * blind.least_rise
    assert (
        compare(BY_ACTIVITY, flown(21, 0.05 * (1.0 + 1.3 * seeing.least_rise)), PAST).condition == "changed"
    )


def test_a_flight_beyond_the_activity_of_the_others_is_undecided() -> None:
    rough, calm = lively(RECORDS[0], 5.0), lively(RECORDS[0], 0.2)
    assert compare(BY_ACTIVITY, rough, PAST).why == "its flight was rougher than any of its baseline"
    assert compare(BY_ACTIVITY, calm, PAST).why == "its flight was calmer than any of its baseline"
    assert compare(EQUATION, rough, PAST).condition != "undecided"


def test_temperatures_too_close_together_give_no_slope() -> None:
    def at(*several: float) -> list[OwnRecord]:
        return [RECORDS[0].model_copy(update={"temperature_c": warmth}) for warmth in several]

    assert not differences(EQUATION, at(20.0, 24.0), warm=True)
    assert not differences(EQUATION, at(20.0, 30.0), warm=False)
    assert not differences(EQUATION, [*at(20.0, 30.0), RECORDS[1]], warm=True)
    [warmth] = differences(EQUATION, at(20.0, 30.0), warm=True)
    assert warmth.at(at(27.0)[0]) == 2.0
    assert warmth.at(RECORDS[1]) == 0.0, "what is not known is taken as the mean"
    assert [warmth.beyond(record) for record in at(16.0, 18.0, 32.0, 34.0)] == ["colder", "", "", "warmer"]


def swept(load: float, strokes: int = 4, *, against: int = 0) -> OwnRecord:
    """Return strokes with a load, ``against`` of them the other way."""
    rows = tuple((1.0, 0.3, load if k >= against else -load) for k in range(strokes))
    return RECORDS[0].model_copy(update={"equation": TWO_WAYS.name, "groups": rows})


def test_a_load_is_fitted_where_the_flights_loads_differ_by_more_than_three_tenths() -> None:
    def loads(*several: float) -> tuple[bool, float]:
        found = differences(TWO_WAYS, [swept(load) for load in several], warm=False)
        return found[0].fitted, found[0].margin

    assert loads(1.0, 1.3) == (False, 0.05 * 1.3)
    assert loads(1.0, 1.31) == (True, 0.05 * 1.31)


def test_a_direction_of_the_load_is_fitted_where_it_differs_between_the_flights() -> None:
    def direction(*against: int) -> bool:
        found = differences(TWO_WAYS, [swept(1.0, against=each) for each in against], warm=False)
        return found[1].fitted

    assert [direction(0, 2), direction(0, 3), direction(0, 4)] == [False, True, True]


def test_fewer_strokes_than_in_any_reference_flight_are_beyond_it() -> None:
    shorter = differences(TWO_WAYS, [swept(1.0, 6), swept(1.0, 4)], warm=False)[-1]
    assert [shorter.beyond(swept(1.0, each)) for each in (3, 4, 99)] == ["shorter in strokes", "", ""]
    assert not shorter.fitted
