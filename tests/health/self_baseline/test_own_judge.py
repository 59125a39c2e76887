"""A flight held against the flights before: learning, unchanged, changed, and what they promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations.own_scale import TRACKING
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.motor_identification import VoltageSums
from mavhums.health.estimation.random_effects import population
from mavhums.health.self_baseline.comparison import compare
from mavhums.health.self_baseline.verdict import compare_with_own_flights, comparison_reason
from mavhums.results.verdict import OwnRecord
from tests.health.builders import verdict
from tests.health.self_baseline.servo import EQUATION, Servo, blank, collected, left, past, scaled
from tests.present import present


def flight(seed: int, friction_a: float = 0.05) -> OwnRecord:
    scattered = friction_a * (1.0 + 0.02 * np.random.default_rng([seed, 1]).standard_normal())
    return left(Servo(friction_a=scattered), seed, seconds=60.0)


HEALTHY = past(*(flight(seed) for seed in range(12)))


def test_fewer_than_ten_flights_are_learning() -> None:
    for before in (0, 5, 9):
        found = compare(EQUATION, flight(50), HEALTHY[:before])
        assert (found.condition, found.flights, found.needed) == ("learning", before + 1, 10)
        assert present(found.value).estimate == pytest.approx(0.05, rel=0.1)
    assert comparison_reason(EQUATION, found).code == "own_learning"


def test_a_flight_like_those_before_is_unchanged_and_says_what_it_would_have_seen() -> None:
    found = compare(EQUATION, flight(51), HEALTHY)
    assert found.condition == "unchanged"
    assert present(found.baseline).low < 0.05 < present(found.baseline).high
    risen = flight(52, 0.05 * (1.0 + 1.3 * present(found.least_rise)))
    assert compare(EQUATION, risen, HEALTHY).condition == "changed"


def test_a_fall_is_no_wear() -> None:
    assert compare(EQUATION, flight(53, 0.03), HEALTHY).condition == "unchanged"


def test_a_rise_is_changed_since_the_first_flight_of_an_unbroken_row() -> None:
    extra = [flight(60 + k) for k in range(8)]
    worn = [flight(80, 0.08), flight(81), flight(82, 0.08), flight(83, 0.08)]
    flights = past(*(p.records[0] for p in HEALTHY), *extra, *worn)
    found = compare(EQUATION, flight(84, 0.08), flights)
    assert found.condition == "changed"
    assert present(found.change).estimate == pytest.approx(0.6, abs=0.1)
    assert present(found.since).flight == 23
    reason = comparison_reason(EQUATION, found)
    assert reason.code == "own_changed"
    assert "since flight 23 (2026-03-23): friction" in reason.text
    value, usual, change = present(found.value), present(found.baseline), present(found.change)
    halves = value.high - value.estimate, usual.high - usual.estimate
    ratio = (change.high - change.estimate) / (np.hypot(*halves) / usual.estimate)
    assert ratio == pytest.approx(1.0, abs=0.3)
    # Further back it is not looked for.
    again = compare(EQUATION, flight(84, 0.08), [*flights, *flights[-1:] * 220])
    assert present(again.since).flight == 45


def test_a_fault_that_blurs_its_own_quantity_is_changed() -> None:
    """Sometimes the servo follows and sometimes it is far behind: the mean is as uncertain as it is large."""
    fair, grave = flight(85), flight(86, 0.5)
    blurred = fair.model_copy(update={"groups": (*fair.groups[:4], *grave.groups[4:])})
    assert compare(EQUATION, blurred, HEALTHY).condition == "unchanged"
    tracking = replace(EQUATION, blurs=True)
    assert compare(tracking, blurred, HEALTHY).condition == "changed"
    healthy = compare(tracking, flight(87), HEALTHY)
    assert healthy.condition == "unchanged"
    assert healthy.least_rise == compare(EQUATION, flight(87), HEALTHY).least_rise
    assert TRACKING.blurs


def test_a_reversed_current_wears_as_well() -> None:
    before = past(*(scaled(p.records[0], **{KEPT[-1]: -1.0}) for p in HEALTHY))
    for own, condition in ((flight(54, 0.09), "changed"), (flight(55), "unchanged")):
        assert compare(EQUATION, scaled(own, **{KEPT[-1]: -1.0}), before).condition == condition


def test_only_flights_measured_alike_are_compared() -> None:
    other = [p._replace(records=(p.records[0].model_copy(update={"setup": "other"}),)) for p in HEALTHY]
    assert compare(EQUATION, flight(56), other).condition == "learning"
    faster = [p._replace(records=(p.records[0].model_copy(update={"rate_hz": 100.0}),)) for p in HEALTHY]
    assert compare(EQUATION, flight(56), faster).condition == "learning"
    sick = [p._replace(healthy=False) for p in HEALTHY]
    assert compare(EQUATION, flight(56), sick).condition == "learning"


def test_tracking_takes_twenty_flights() -> None:
    equation = replace(TRACKING, name=EQUATION.name)
    assert compare(equation, flight(57), HEALTHY).condition == "learning"


@pytest.mark.slow
@pytest.mark.parametrize("scatter", [0.0, 0.03, 0.05])
def test_natural_scatter_alarms_no_oftener_than_promised(scatter: float) -> None:
    """One look a flight at one in 100; healthy flights that scatter by so much of their mean."""
    rng = np.random.default_rng(7)
    ones, errors = np.ones((10, 1)), np.full(10, 0.02)
    from scipy.special import stdtrit

    alarms = 0
    for _ in range(1500):
        values = 1.0 + np.hypot(scatter, 0.02) * rng.standard_normal(11)
        known = population(ones, values[1:], errors)
        variance = known.variance_at(np.ones(1)) + 0.02**2
        alarms += values[0] - known.coefficients[0] > stdtrit(known.freedom, 0.99) * np.sqrt(variance)
    assert alarms <= 15 + 3 * np.sqrt(15)


def test_a_verdict_is_replaced_where_no_limit_or_jam_decides() -> None:
    worn = verdict(own=(flight(58, 0.09),))
    found = compare_with_own_flights(worn, HEALTHY)
    assert (found.condition, found.worst) == ("changed", "changed")
    assert [suspect.fault for suspect in found.suspects] == ["friction_current"]
    assert found.indicators[0].baseline_flights == 12
    assert found.indicators[0].least_rise is not None
    assert found.remedy == "inspect gearbox, bearings and hinge line"
    assert compare_with_own_flights(found, HEALTHY) == found
    assert compare_with_own_flights(found, HEALTHY[:3]).condition == "learning"
    jammed = verdict(worst="emergency", own=(flight(58),))
    assert compare_with_own_flights(jammed, HEALTHY) is jammed
    bare = worn.model_copy(update={"own": ()})
    assert compare_with_own_flights(bare, HEALTHY) is bare
    sound = compare_with_own_flights(verdict(own=(flight(51),)), HEALTHY)
    assert (sound.condition, sound.reason_codes) == ("unchanged", ("own_unchanged",))


def test_a_weaker_motor_is_separated_from_friction() -> None:
    """A torque constant that falls by 20 % raises every current by 25 %, and lowers the back-EMF."""

    def records(seed: int, left_of_it: float, friction_a: float = 0.05) -> tuple[OwnRecord, OwnRecord]:
        whole = Servo(friction_a=friction_a)
        weak = replace(
            whole,
            friction_a=whole.friction_a / left_of_it,
            drag=whole.drag / left_of_it,
            inertia=whole.inertia / left_of_it,
            hinge=whole.hinge / left_of_it,
            back_emf=whole.back_emf * left_of_it,
        )
        voltage = present(collected(VoltageSums(blank()), weak.flown(seed, seconds=60.0)))
        return left(weak, seed, seconds=60.0), voltage

    before = [PastRecord(records(seed, 1.0), "2026-03-01", True) for seed in range(12)]
    weak = compare_with_own_flights(verdict(own=records(70, 0.8)), before)
    assert weak.condition == "changed"
    assert [suspect.fault for suspect in weak.suspects] == ["torque_constant"]
    assert weak.reason_codes == ("own_constant",)
    assert "constant -20%; the friction current +" in (weak.reason or "")
    worn = compare_with_own_flights(verdict(own=records(71, 1.0, 0.08)), before)
    assert [suspect.fault for suspect in worn.suspects] == ["friction_current"]
