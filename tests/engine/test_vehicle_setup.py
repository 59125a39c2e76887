"""When a vehicle's profile and parameters apply, and what becomes of its axes by them."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.actuator.contradictions import Contradiction
from mavhums.actuator.profile import load_airframe
from mavhums.engine.vehicle_setup import SetupHistory, VehicleSetup, setup_notices
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import SurfaceOutput, Surfaces

PAPER = load_airframe("paper")
AILERONS = tuple(SurfaceOutput(servo, "aileron", 1500, 400) for servo in (1, 2))


def parameters(servo: int) -> Parameters:
    """One output that moves an aileron."""
    return Parameters(1, False, {f"SERVO{servo}_FUNCTION": 4.0})


def test_a_fact_applies_ten_seconds_after_it_was_read() -> None:
    history, first = SetupHistory(), parameters(1)
    history.add_parameters(100, first)
    assert [history.at(second).parameters for second in (109, 110)] == [None, first]
    assert [history.next_s(second) for second in (-1, 109, 110)] == [110, 110, None]
    history.add_parameters(105, Parameters(1, False, dict(first.values)))
    assert history.next_s(110) is None, "the same parameters are no other fact"


@pytest.mark.parametrize(("second", "applies_s"), [(101, 110), (107, 110), (108, 118), (500, 510)])
def test_what_comes_while_its_seconds_are_unsettled_applies_with_the_fact_before(
    second: int, applies_s: int
) -> None:
    history, later = SetupHistory(), parameters(2)
    history.add_parameters(100, parameters(1))
    history.add_parameters(second, later)
    assert history.at(applies_s).parameters is later
    assert history.at(applies_s - 1).parameters is not later
    assert (history.next_s(110) is None) == (applies_s == 110)


def test_a_profile_does_not_wait_for_parameters_and_applies_before_what_came_first() -> None:
    history = SetupHistory()
    history.add_parameters(100, parameters(1))
    history.add_profile(50, PAPER)
    assert history.at(59) == VehicleSetup()
    assert (history.at(60).airframe, history.at(60).parameters) == (PAPER, None)
    assert (history.at(110).airframe, history.at(110).parameters) == (PAPER, parameters(1))
    history.add_profile(107, PAPER)
    assert history.next_s(110) == 117


def test_the_oldest_of_many_changes_is_forgotten() -> None:
    history = SetupHistory()
    for k in range(65):
        history.add_parameters(100 * k, parameters(1 + k % 2))
    assert history.at(0).parameters == parameters(1), "the first change counts from the start"
    assert history.next_s(0) == 110
    assert history.at(110).parameters == parameters(2)
    assert history.last.parameters == parameters(1)


def test_an_actuator_is_refused_where_its_output_moves_something_else() -> None:
    history = SetupHistory(PAPER)
    elevator = next(one for one in PAPER.actuators if one.name == "elevator")
    history.add_parameters(20, parameters(elevator.servo))
    times = np.array([0.0, 29.9, 30.0, 99.0])
    assert history.refused("elevator", times).tolist() == [False, False, True, True]
    assert not history.refused("rudder", times).any()


def test_a_notice_says_what_no_verdict_of_an_actuator_does() -> None:
    servo, travel = (Contradiction(1, "rudder", key, f"its {key}") for key in ("servo", "travel_deg"))
    by_log = Surfaces(AILERONS, "profile", by_log=frozenset({"roll"}), contradicted={"roll": "x", "yaw": "y"})
    assert [*setup_notices(VehicleSetup(contradictions=(servo,)), None)] == []
    assert len([*setup_notices(VehicleSetup(contradictions=(servo, travel)), None)]) == 1
    assert [*setup_notices(VehicleSetup(), by_log)] == [
        "roll: judged by the log's parameters, which contradict the profile"
    ]
