"""The single mass against its data sheet and against solutions on paper."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from mavhums_sim.ema import DataSheet, EmaParameters
from mavhums_sim.motion import Motion, simulate

PAPER = EmaParameters.from_data_sheet()
SHEET = DataSheet()
COULOMB = 0.225


def drive(
    parameters: EmaParameters,
    command: float,
    seconds: float,
    *,
    load: float | tuple[float, float] = 0.0,
    friction: float = COULOMB,
) -> Motion:
    """A step of the command from rest, against a load that is constant or grows linearly."""
    n = round(seconds * 1000)
    start, end = load if isinstance(load, tuple) else (load, load)
    return simulate(
        parameters, np.full(n, command), np.full(n, friction), np.zeros(n), np.linspace(start, end, n)
    )


def test_no_load_speed_is_the_data_sheets() -> None:
    motion = drive(PAPER, radians(60), 0.5)
    assert np.degrees(motion.speed[300:]) == pytest.approx(SHEET.no_load_speed_deg_s, rel=1e-3)


def test_nominal_torque_takes_the_nominal_current() -> None:
    motion = drive(PAPER, radians(60), 0.6, load=SHEET.nominal_torque_nm)
    assert motion.speed[-1] > 0
    assert motion.current[-1] == pytest.approx(SHEET.nominal_current_a, rel=1e-3)


def test_moving_shaft_stalls_at_the_stall_torque() -> None:
    motion = drive(PAPER, radians(60), 4.0, load=(4.9, 5.1))
    assert motion.speed[1000] > 0
    stalled = int(np.flatnonzero(motion.speed[1000:] <= 0)[0]) + 1000
    assert motion.load[stalled] == pytest.approx(SHEET.stall_torque_nm, rel=1e-3)


def test_stroke_is_the_data_sheets() -> None:
    assert np.degrees(drive(PAPER, radians(200), 2.0).angle[-1]) == pytest.approx(SHEET.stroke_deg, abs=0.5)


def test_supply_limits_the_speed_when_the_controller_does_not() -> None:
    free = replace(PAPER, slew_limit=1e3, stroke=1e3)
    motion = drive(free, 1e3, 1.0)
    loss = PAPER.resistance * COULOMB / PAPER.torque_per_ampere
    assert motion.speed[-1] == pytest.approx((27.0 - loss) / PAPER.torque_per_ampere, rel=1e-6)


def test_current_of_a_stalled_motor_rises_exponentially() -> None:
    slow_winding = replace(PAPER, inductance=0.5)
    motion = drive(slow_winding, radians(60), 0.1, friction=1e6)
    time_constant = slow_winding.inductance / slow_winding.resistance
    expected = 27.0 / slow_winding.resistance * (1 - np.exp(-motion.time_s / time_constant))
    assert motion.current == pytest.approx(expected, rel=1e-9)
    assert not motion.speed.any()


@pytest.mark.parametrize(("load", "moves"), [(1.19 * COULOMB, False), (1.21 * COULOMB, True)])
def test_resting_shaft_breaks_away_at_the_stiction(load: float, moves: bool) -> None:
    dead = replace(PAPER, speed_gain=0.0)
    assert drive(dead, 0.0, 0.05, load=load).speed.any() == moves


def test_constant_load_accelerates_the_free_shaft_uniformly() -> None:
    """Without current the load alone works against the friction: ω = (T_ext - T_c)/J·t."""
    dead = replace(PAPER, torque_per_ampere=1e-9)
    motion = drive(dead, 0.0, 0.1, load=-1.0)
    assert motion.speed == pytest.approx((1.0 - COULOMB) / PAPER.inertia * motion.time_s, rel=1e-6)


def test_friction_alone_decides_what_the_same_command_costs() -> None:
    light, heavy = (drive(PAPER, radians(60), 0.5, friction=t).current[400] for t in (0.225, 1.025))
    assert (heavy - light) * PAPER.torque_per_ampere == pytest.approx(0.8, rel=1e-6)


def test_moving_fraction_counts_the_samples_in_motion() -> None:
    assert drive(PAPER, 0.0, 0.1).moving_fraction == 0.0
    assert drive(PAPER, radians(60), 0.1).moving_fraction > 0.95


def test_data_sheet_of_another_servo_gives_another_servo() -> None:
    sheet = DataSheet(
        nominal_torque_nm=1.0, stall_torque_nm=2.0, no_load_speed_deg_s=300.0, supply_voltage_v=12.0
    )
    servo = EmaParameters.from_data_sheet(sheet, healthy_friction_nm=0.1)
    motion = drive(servo, radians(60), 0.15, friction=0.1)
    assert servo.resistance * servo.current_limit == pytest.approx(12.0)
    assert np.degrees(motion.speed.max()) == pytest.approx(300.0, rel=0.01)


def test_integral_gain_removes_the_droop() -> None:
    servo = EmaParameters.from_data_sheet(integral_gain=400.0)
    motion = drive(servo, radians(60), 0.5, friction=0.5)
    assert np.degrees(motion.speed[400]) == pytest.approx(100.0, rel=2e-3)
