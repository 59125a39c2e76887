"""Resistance and back-EMF constant of a motor, followed from flight to flight."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from mavhums.health.decision.baseline import PastRecord
from mavhums.health.self_baseline.motor import MOTOR_FAULTS, _prediction, motor_indicators
from mavhums.health.self_baseline.verdict import compare_with_own_flights, without_own
from mavhums.results.verdict import Interval
from tests.health.builders import verdict
from tests.health.self_baseline import servo
from tests.present import present

voltage = partial(servo.voltage, seconds=60.0)
PAST = [PastRecord((voltage(seed),), "2026-03-01", True) for seed in range(10)]


def test_a_motor_is_shown_beside_its_earlier_flights() -> None:
    resistance, back_emf = motor_indicators([voltage(30, servo.Servo(resistance=22.0))], PAST)
    assert (resistance.fault, back_emf.fault) == MOTOR_FAULTS
    assert resistance.value.estimate == pytest.approx(22.0, rel=0.02)
    assert back_emf.value.estimate == pytest.approx(0.015, rel=0.02)
    assert present(resistance.baseline).estimate == pytest.approx(20.0, rel=0.02)
    assert present(resistance.baseline).high < 22.0
    assert present(back_emf.baseline).low < back_emf.value.estimate < present(back_emf.baseline).high
    assert resistance.baseline_flights == resistance.needed_flights == 10


def test_the_baseline_is_the_prediction_interval_of_one_more_flight() -> None:
    """Mean ± t · s · √(1 + 1/n) with t of n − 1 degrees of freedom: 2.262 for ten flights (any table)."""
    values = 20.0 + np.array([-0.3, 0.1, 0.2, -0.1, 0.4, 0.0, -0.2, 0.3, -0.4, 0.5])
    earlier = [Interval(estimate=value, low=value - 1.0, high=value + 1.0) for value in values.tolist()]
    found = present(_prediction(earlier))
    spread = float(np.sqrt(np.sum((values - values.mean()) ** 2) / 9)) * 1.1**0.5
    assert found.estimate == pytest.approx(values.mean(), rel=1e-4)
    halves = found.high - found.estimate, found.estimate - found.low
    assert halves == pytest.approx([2.262 * spread] * 2, abs=2e-3)
    assert _prediction(earlier[:9]) is None


def test_nine_flights_make_no_baseline_and_unsound_ones_do_not_count() -> None:
    [resistance, _] = motor_indicators([voltage(31)], PAST[:9])
    assert resistance.baseline is None
    assert resistance.baseline_flights == 9
    [again, _] = motor_indicators([voltage(31)], [*PAST[:9], PAST[9]._replace(healthy=False)])
    assert again == resistance


def test_without_voltage_there_is_no_motor() -> None:
    assert motor_indicators([servo.left(servo.Servo(), 32, seconds=60.0)], PAST) == ()


def test_a_verdict_carries_them_once_and_alone_it_has_none() -> None:
    alone = verdict(own=(servo.left(servo.Servo(), 33, seconds=60.0), voltage(33)))
    once = compare_with_own_flights(alone, [])
    assert [shown.fault for shown in once.indicators] == ["friction_current", *MOTOR_FAULTS]
    assert compare_with_own_flights(once, []) == once
    assert without_own(once).indicators == ()
