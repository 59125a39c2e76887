"""Flights: what decides them, what they record, what they refuse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mavhums_sim import Flight, fly
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.sensors import Registers, SensorNoise, sample_times, sense

DEGREES, REV_MIN = 180 / np.pi, 30 / np.pi


def test_the_seed_decides_the_flight() -> None:
    one, same, other = (fly(Flight(seed=seed, duration_s=5.0)) for seed in (5, 5, 6))
    for surface in SURFACES:
        np.testing.assert_array_equal(one.actuators[surface].values, same.actuators[surface].values)
    assert not np.array_equal(one.actuators["elevator"].values, other.actuators["elevator"].values)


def test_command_does_not_know_the_condition() -> None:
    healthy = fly(Flight(seed=3, duration_s=5.0))
    worn = fly(Flight(seed=3, duration_s=5.0, friction_nm={"elevator": (1.0, 1.0)}))
    for surface in SURFACES:
        one, other = healthy.actuators[surface], worn.actuators[surface]
        np.testing.assert_array_equal(one.time_s, other.time_s)
        np.testing.assert_array_equal(one.values[:, 0], other.values[:, 0])
    assert not np.array_equal(healthy.actuators["elevator"].values, worn.actuators["elevator"].values)


def test_truth_states_the_condition_and_the_motion() -> None:
    record = fly(Flight(seed=2, duration_s=5.0, friction_nm={"rudder": (0.3, 0.9)}))
    truth: dict[str, Any] = record.truth()
    rudder, elevator = truth["actuators"]["rudder"], truth["actuators"]["elevator"]
    assert (rudder["fault"], elevator["fault"]) == ("friction", "none")
    assert rudder["friction_nm"] == {"start": pytest.approx(0.3), "end": pytest.approx(0.9)}
    assert elevator["friction_nm"] == {"start": pytest.approx(0.225), "end": pytest.approx(0.225)}
    moving = np.mean(np.abs(np.degrees(record.actuators["rudder"].motion.speed)) > 0.1)
    assert rudder["moving_fraction"] == pytest.approx(moving, abs=1e-4)


def test_hinge_moment_reaches_a_good_part_of_the_nominal_torque() -> None:
    load = fly(Flight(seed=0)).actuators["elevator"].motion.load
    assert 0.4 * 3.5 < np.abs(load).max() < 3.5


def test_sampling_jitters_and_never_goes_back() -> None:
    times = sample_times(np.random.default_rng(0), 10.0, 50.0)
    steps = np.diff(times)
    assert times.size == 500
    assert steps.min() > 0.5 / 50
    assert steps.max() < 1.5 / 50
    assert steps.std() > 0.1 / 50
    phase = np.exp(2j * np.pi * times / 1e-3)
    assert abs(phase.mean()) < 0.15  # no lock to the controller's millisecond


def test_perfect_sensors_show_the_truth_in_the_papers_units() -> None:
    flight = Flight(seed=4, duration_s=10.0, noise=SensorNoise.none())
    actuator = fly(flight).actuators["elevator"]
    p, motion = flight.parameters, actuator.motion

    def at(signal: Any) -> Any:
        return np.interp(actuator.time_s, motion.time_s, signal)

    v = dict(enumerate(actuator.values.T, start=1))
    np.testing.assert_allclose(v[1], at(motion.command) * DEGREES)
    np.testing.assert_allclose(v[2], at(motion.angle) * DEGREES * p.gear_ratio)
    np.testing.assert_allclose(v[3], at(motion.angle) * DEGREES)
    np.testing.assert_allclose(v[4], at(motion.voltage))
    np.testing.assert_allclose(v[5], at(motion.current))
    np.testing.assert_allclose(v[6], v[4] * v[5])
    np.testing.assert_allclose(v[7], at(motion.speed) * REV_MIN * p.gear_ratio)
    np.testing.assert_allclose(v[8], v[5] * p.torque_per_ampere / p.gear_ratio)
    np.testing.assert_allclose(v[9], v[8] * v[7] / REV_MIN)
    np.testing.assert_allclose(v[10], v[7] / p.gear_ratio)
    np.testing.assert_allclose(v[11], at(motion.load))
    np.testing.assert_allclose(v[12], v[11] * v[10] / REV_MIN)


def test_sensor_noise_has_the_stated_deviation() -> None:
    flight = Flight(seed=4, duration_s=10.0)
    actuator = fly(flight).actuators["elevator"]
    rng = np.random.default_rng(0)
    noise = SensorNoise()
    noisy = sense(actuator.motion, flight.parameters, actuator.time_s, rng, noise)
    exact = sense(actuator.motion, flight.parameters, actuator.time_s, rng, SensorNoise.none())
    spread = (noisy - exact).std(axis=0)
    assert spread[0] == 0.0
    for column, expected in (
        (1, noise.rotor_angle_deg),
        (2, noise.output_angle_deg),
        (3, noise.voltage_v),
        (4, noise.current_a),
        (6, noise.rotor_speed_rev_min),
        (10, noise.output_torque_nm),
    ):
        assert spread[column] == pytest.approx(expected, rel=0.15)


def test_registers_come_in_steps_late_without_sign_and_with_gaps() -> None:
    flight = Flight(seed=5, duration_s=20.0)
    plain = fly(flight).actuators["rudder"]
    read = fly(replace(flight, registers=Registers(lost=0.05))).actuators["rudder"]
    rows = np.searchsorted(plain.time_s, read.time_s)
    np.testing.assert_array_equal(plain.time_s[rows], read.time_s)
    assert 0.02 < 1.0 - read.time_s.size / plain.time_s.size < 0.08
    assert np.isnan(read.values[:, [1, 5, 7, 8, 9, 10, 11]]).all()
    np.testing.assert_allclose(read.values[:, 2], plain.values[rows, 2], atol=0.5 * 360.0 / 4096.0 + 1e-9)
    current = read.values[:, 4]
    assert (current >= 0.0).all()
    assert np.unique(np.column_stack([np.floor(read.time_s), current]), axis=0).shape[0] == 20
    late, now = (np.interp(read.time_s - lag, plain.time_s, plain.values[:, 6]) for lag in (0.01, 0.0))
    assert np.abs(read.values[:, 6] - late).mean() < 0.75 * np.abs(read.values[:, 6] - now).mean()
