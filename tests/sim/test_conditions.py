"""Conditions over time, and what each does to the actuator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums_sim import EmaParameters, Flight, FlightRecord, fly
from mavhums_sim.conditions import FAULTS, Condition, degrade
from mavhums_sim.ema import DataSheet
from mavhums_sim.individuals import Individual
from mavhums_sim.motion import Degradation, simulate
from mavhums_sim.sensors import SensorNoise

Array = NDArray[np.float64]

TIME = np.arange(1.0, 11.0, dtype=np.float64)
TWO = EmaParameters.from_data_sheet().two_masses()


@pytest.mark.parametrize(
    ("condition", "onset", "severity"),
    [
        (Condition.constant("jam", 2.0), "constant", [2.0] * 10),
        (Condition.step("jam", 2.0, 4.0), "step", [0.0] * 3 + [2.0] * 7),
        (Condition.growing("jam", 3.0, 4.0), "growing", [0, 0, 0, 0, 0.5, 1, 1.5, 2, 2.5, 3]),
        (Condition("jam", 10.0, 10.0, 3.0, 6.0), "step", [0, 0, 10, 10, 10, 0, 0, 0, 0, 0]),
        (Condition("friction", 0.0, 0.3, 3.0, 6.0), "growing", [0, 0, 0, 0.1, 0.2, 0, 0, 0, 0, 0]),
    ],
)
def test_onsets_over_time(condition: Condition, onset: str, severity: list[float]) -> None:
    np.testing.assert_allclose(condition.severity(TIME), severity, atol=1e-12)
    assert condition.onset == onset
    assert condition.truth().get("until_s") == (6.0 if condition.until_s == 6.0 else None)


def test_severities_of_one_fault_add() -> None:
    both = [Condition.constant("friction", 0.1), Condition.growing("friction", 0.9, 1.0)]
    friction, wear = degrade(both, TIME, 0.98)
    assert friction[-1] == pytest.approx(1.0)
    assert friction[0] == pytest.approx(0.1)
    np.testing.assert_array_equal(wear.torque_factor, np.full(10, 0.98))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("rust", 0.1, 0.1), "no fault 'rust'"),
        (("friction", -0.1, 0.1), "impossible"),
        (("torque_constant", 0.1, 1.1), "impossible"),
        (("supply_sag", 27.0, 27.0), "impossible"),
        (("jam", 1.0, np.inf), "impossible"),
        (("jam", 1.0, 1.0, -1.0), "not a flight time"),
        (("jam", 10.0, 10.0, 5.0, 5.0), "not after the onset"),
    ],
)
def test_impossible_conditions_are_refused(arguments: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Condition(*arguments)


def flown(*conditions: Condition) -> FlightRecord:
    quiet = Flight(seed=9, duration_s=20.0, noise=SensorNoise.none(), parameters=TWO)
    return fly(replace(quiet, conditions={"elevator": conditions} if conditions else {}))


@pytest.fixture(scope="module")
def healthy() -> Array:
    return flown().actuators["elevator"].values


def worn_by(fault: str, severity: float) -> Array:
    return flown(Condition.constant(fault, severity)).actuators["elevator"].values


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_shows_somewhere_and_never_in_the_command(fault: str, healthy: Array) -> None:
    changed = worn_by(fault, {"supply_sag": 20.0, "jam": 10.0}.get(fault, 0.5)) != healthy
    assert not changed[:, 0].any()
    assert changed[:, 1:].any()


def test_friction_costs_current(healthy: Array) -> None:
    worn = worn_by("friction", 0.5)
    moving = np.abs(healthy[:, 6]) > 300
    extra = (worn[:, 4] - healthy[:, 4])[moving] * np.sign(healthy[moving, 6])
    assert np.median(extra) * TWO.torque_per_ampere == pytest.approx(0.5, rel=0.05)


def test_backlash_separates_rotor_and_output() -> None:
    played = flown(Condition.constant("backlash", 0.5)).actuators["elevator"]
    twist = np.degrees(played.motion.rotor_angle - played.motion.angle)
    assert np.ptp(twist) == pytest.approx(0.58, abs=0.8)
    assert np.abs(twist).max() > 0.29


def test_resistance_is_overcome_by_voltage(healthy: Array) -> None:
    worn = worn_by("resistance", 0.2)
    loaded = np.abs(healthy[:, 4]) > 0.2
    drop = (worn[:, 3] - healthy[:, 3])[loaded] / healthy[loaded, 4]
    assert np.median(drop) == pytest.approx(0.2 * TWO.resistance, rel=0.1)


def test_torque_constant_lost_is_made_up_by_current(healthy: Array) -> None:
    worn = worn_by("torque_constant", 0.2)
    loaded = np.abs(healthy[:, 4]) > 0.2
    assert np.median((worn[:, 4] / healthy[:, 4])[loaded]) == pytest.approx(1.25, rel=0.05)


def test_sag_caps_the_voltage(healthy: Array) -> None:
    assert np.abs(worn_by("supply_sag", 20.0)[:, 3]).max() <= 7.0 < np.abs(healthy[:, 3]).max()


def test_controller_believes_a_biased_sensor(healthy: Array) -> None:
    worn = worn_by("sensor_bias", 0.5)
    apart = (worn[:, 2] - worn[:, 1] / 300.0) - (healthy[:, 2] - healthy[:, 1] / 300.0)
    assert np.median(apart) == pytest.approx(0.5, abs=0.02)
    assert np.median(worn[:, 2] - healthy[:, 2]) == pytest.approx(0.0, abs=0.05)


def test_jammed_shaft_rests_while_the_motor_pushes() -> None:
    jammed = flown(Condition.step("jam", 10.0, 10.0)).actuators["elevator"].motion
    assert np.ptp(jammed.angle[11_000:]) == 0.0
    assert np.ptp(jammed.command[11_000:]) > 0.0


def test_truth_names_what_was_wrong() -> None:
    truth: Any = flown(Condition.step("jam", 10.0, 15.0), Condition.growing("backlash", 1.0)).truth()
    elevator = truth["actuators"]["elevator"]
    assert elevator["fault"] == "jam+backlash"
    jam = {"fault": "jam", "unit": "N·m", "onset": "step", "at_s": 15.0, "start": 10.0, "end": 10.0}
    assert elevator["conditions"][0] == jam
    assert truth["model"] == "two-mass"


def test_rigid_gear_has_no_backlash() -> None:
    with pytest.raises(ValueError, match="two-mass"):
        Flight(conditions={"rudder": (Condition.constant("backlash", 0.1),)})
    zeros = np.zeros(3)
    wear = replace(Degradation.none(3), backlash=zeros + 0.1)
    with pytest.raises(ValueError, match="two masses"):
        simulate(EmaParameters.from_data_sheet(), zeros, zeros, zeros, zeros, wear)
    with pytest.raises(ValueError, match="3 values"):
        simulate(TWO, zeros, zeros, zeros, np.zeros(2))


def test_individuals_scatter_about_the_data_sheet_as_stated() -> None:
    drawn = [Individual.draw(seed, 2) for seed in range(400)]
    for name, spread in (("torque_constant", 0.03), ("friction", 0.1), ("hinge", 0.1), ("inertia", 0.1)):
        values = np.array([getattr(one, name) for one in drawn])
        assert values.mean() == pytest.approx(1.0, abs=0.15 * spread)
        assert values.std() == pytest.approx(spread, rel=0.12)
        assert np.abs(values - 1.0).max() <= 2.5 * spread + 1e-12
    viscous = np.array([one.viscous for one in drawn])
    assert 0.0 <= viscous.min() < 0.005
    assert 0.045 < viscous.max() <= 0.05
    assert Individual.draw(7, 1) == Individual.draw(7, 1) != Individual.draw(7, 2)


def test_individual_flies_its_own_friction_and_states_it() -> None:
    record = fly(Flight(seed=1, duration_s=2.0, individuals=5))
    mine = Individual.draw(5, 2)
    elevator = record.actuators["elevator"]
    assert elevator.individual == mine
    assert elevator.motion.friction[0] == pytest.approx(0.225 * mine.friction)
    np.testing.assert_array_equal(elevator.motion.degradation.torque_factor, mine.torque_constant)


@pytest.mark.parametrize("trait", ["hinge", "inertia", "viscous", "torque_constant", "friction"])
def test_each_trait_of_an_individual_counts(trait: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A factor of 1.5 (or drag of 0.5 N·m·s/rad) on one trait shows where it should."""
    odd = replace(Individual(), **{trait: 0.5 if trait == "viscous" else 1.5})
    flight = Flight(seed=2, duration_s=20.0, noise=SensorNoise.none())
    nominal = fly(flight).actuators["elevator"]
    monkeypatch.setattr(Individual, "draw", classmethod(lambda cls, seed, index: odd))
    mine = fly(replace(flight, individuals=0)).actuators["elevator"]
    load = np.abs(mine.motion.load).max() / np.abs(nominal.motion.load).max()
    assert load == pytest.approx(1.5 if trait == "hinge" else 1.0, abs=0.03)
    assert not np.allclose(mine.values[:, 4], nominal.values[:, 4], atol=1e-4)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [({"nominal_torque_nm": 0.0}, "nominal_torque_nm"), ({"stall_torque_nm": 3.0}, "above the nominal")],
)
def test_impossible_data_sheets_are_refused(wrong: dict[str, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        DataSheet(**wrong)
