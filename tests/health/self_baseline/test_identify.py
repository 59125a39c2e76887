"""The motor that flights show, against the motor that flew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mavhums.core.quantities import column
from mavhums.health.estimation.motor_identification import VoltageSums, identified
from mavhums.results.verdict import Interval
from tests.health.self_baseline.servo import Servo, blank, collected, left, voltage
from tests.present import present

SERVO = Servo()


def inside(interval: Interval, truth: float) -> bool:
    return interval.low <= truth <= interval.high


def test_resistance_back_emf_and_drop_are_separated() -> None:
    found = present(identified([voltage(seed) for seed in range(3)]))
    assert found.flights == 3
    assert found.resistance.estimate == pytest.approx(SERVO.resistance, rel=0.01)
    assert found.back_emf.estimate == pytest.approx(SERVO.back_emf, rel=0.01)
    assert found.drop.estimate == pytest.approx(SERVO.drop_v, abs=0.03)


@pytest.mark.parametrize(("noise_a", "drop_v"), [(0.0, 0.3), (0.004, 0.0)])
def test_the_intervals_hold_the_truth(noise_a: float, drop_v: float) -> None:
    held, servo = 0, replace(SERVO, drop_v=drop_v)
    for seed in range(20):
        found = present(identified([voltage(seed, servo, noise_a=noise_a)]))
        held += inside(found.resistance, SERVO.resistance) + inside(found.back_emf, SERVO.back_emf)
    assert held >= 35


def test_magnitudes_identify_nothing() -> None:
    time_s, values, airspeed = SERVO.flown(1)
    record = collected(VoltageSums(blank()), (time_s, np.abs(values), airspeed))
    assert record is None or identified([record]) is None


def test_a_motor_without_resistance_or_without_back_emf_is_not_identified() -> None:
    """A current of the opposite sign gives less than no resistance."""
    assert identified([voltage(1, replace(SERVO, back_emf=0.0))]) is None
    time_s, values, airspeed = SERVO.flown(1)
    values[:, column("V5")] *= -1.0
    record = present(collected(VoltageSums(blank()), (time_s, values, airspeed)))
    assert identified([record]) is None


def test_a_current_at_the_supply_bus_is_not_the_motors() -> None:
    bus = blank().model_copy(update={"esc_side": "bus"})
    assert collected(VoltageSums(bus), SERVO.flown(1)) is None


def test_records_of_other_equations_are_passed_over() -> None:
    assert identified([left(SERVO, 1)]) is None
