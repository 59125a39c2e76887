"""The single mass; `test_validation` compares it with its data sheet and with solutions on paper."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from mavhums_sim.ema import DataSheet, EmaParameters
from mavhums_sim.motion import Motion, simulate

PAPER = EmaParameters.from_data_sheet()


def drive(parameters: EmaParameters, command: float, seconds: float, *, friction: float = 0.225) -> Motion:
    """A step of the command from rest, without load."""
    n = round(seconds * 1000)
    zeros = np.zeros(n)
    return simulate(parameters, np.full(n, command), np.full(n, friction), zeros, zeros)


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
