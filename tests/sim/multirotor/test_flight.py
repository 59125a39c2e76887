"""The multirotor against what can be computed by hand."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil

from mavhums_sim.multirotor.craft import FRAMES, Craft, Event, Plan, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates, pulses, write_tlog

G = 9.80665


def ideal(name: str) -> Craft:
    craft = draw_craft(np.random.default_rng(3), name)
    one = {"gains": np.ones(craft.gains.size), "exponent": 1.0, "mistuning": np.ones(3)}
    none = {"balance": np.zeros(2), "noise": np.zeros(3), "flapping": 0.0, "sag": 0.0, "drag": 0.0}
    return replace(craft, **one, **none)  # type: ignore[arg-type]


def still(seconds: float, event: Event | None = None) -> Plan:
    velocity = np.zeros((int(seconds) + 2, 3))
    velocity[:6, 2] = 3.0
    return Plan(seconds, velocity, np.zeros(len(velocity)), event=event or Event())


@pytest.mark.parametrize("name", FRAMES)
def test_it_hovers_at_its_hover_thrust(name: str) -> None:
    craft = ideal(name)
    flown = fly(craft, still(40.0), 1)
    late = flown.time_s > 30
    assert np.allclose(flown.command[late], craft.hover, rtol=0.01)
    assert np.abs(flown.attitude[late]).max() < 1e-3
    assert np.abs(flown.velocity[late]).max() < 0.05


def test_what_weighs_very_much_falls_freely() -> None:
    flown = fly(ideal("quad x"), still(40.0, Event(payload_s=20.0, mass=1e9)), 1)
    falling = (flown.time_s > 20.2) & (flown.time_s < 21.0)
    fall = np.polyfit(flown.time_s[falling], flown.velocity[falling, 2], 1)[0]
    assert fall == pytest.approx(-G, rel=1e-3)


@pytest.mark.parametrize("name", FRAMES)
def test_mixer_factors_make_pure_torques(name: str) -> None:
    frame = FRAMES[name]
    factors = frame.factors
    assert np.allclose(factors.sum(axis=0), 0)
    gram = factors.T @ factors
    assert np.allclose(gram, np.diag(np.diag(gram)))
    craft = ideal(name)
    answer = craft.torques.T @ factors
    assert np.allclose(answer, np.diag(craft.authority), atol=1e-9)
    assert (craft.authority > 0).all()


@pytest.mark.parametrize("name", ["quad x", "quad +", "hexa x", "octa x"])
def test_the_command_of_a_weak_motor_rises_until_the_attitude_holds(name: str) -> None:
    craft = ideal(name)
    flown = fly(craft, still(60.0, Event(fault_s=30.0, motor=1, loss=0.3)), 1)
    factors = craft.frame.factors
    columns = factors / (factors**2).sum(axis=0)
    before = flown.command[flown.time_s < 30][-1]
    after = flown.command[flown.time_s > 58].mean(axis=0)
    # What the mixer asks for beyond the motion points along the motor's column: lambda times its thrust.
    assert np.allclose((after - before) @ columns, 0.3 * after[1] * columns[1], atol=0.01)


def test_flights_repeat_and_fall_without_a_motor() -> None:
    rng = np.random.default_rng(5)
    craft = draw_craft(rng, "quad x")
    plan = draw_plan(rng, 40.0, event=Event(fault_s=30.0, motor=2, loss=1.0))
    flown, again = fly(craft, plan, 9), fly(craft, plan, 9)
    assert np.array_equal(flown.attitude, again.attitude)
    assert flown.time_s[-1] < 39
    # Motor 3 is at the front left: the craft falls towards it.
    fallen = (flown.time_s > 30.2) & (flown.time_s < 30.4)
    assert flown.rates[fallen, 0].mean() < -0.3
    assert flown.rates[fallen, 1].mean() < -0.3


def test_its_log_holds_the_commands_and_the_frame(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    flown = fly(draw_craft(rng, "hexa +"), draw_plan(rng, 30.0), 2)
    write_tlog(flown, tmp_path / "h.tlog", Rates(outputs=25.0))
    log = mavutil.mavlink_connection(str(tmp_path / "h.tlog"))
    counts: Counter[str] = Counter()
    while (message := log.recv_match()) is not None:
        counts[message.get_type()] += 1
    log.close()
    assert counts["SERVO_OUTPUT_RAW"] == pytest.approx(25 * 42, abs=2)
    assert log.params["FRAME_CLASS"] == 2.0
    # Idle on the ground; in the air the curve of the parameters gives the commanded thrust back.
    assert pulses(np.array([0.0])) == 1150
    x = (pulses(flown.command) / 1000 - 1 - 0.15) / 0.85
    assert np.allclose(0.35 * x + 0.65 * x**2, flown.command, atol=1e-3)
