"""Comparisons of estimates that are known exactly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mavhums.health.estimation.motor_identification import VOLTAGE
from mavhums.health.self_baseline import motor
from mavhums.results.verdict import Interval, OwnRecord
from tests.present import present


def record(**changes: Any) -> OwnRecord:
    """Return what a flight leaves of the voltage: 10 V of supply, and a highest current of 1 A."""
    known = {"equation": VOLTAGE, "setup": "", "rate_hz": 25.0, "duration_s": 60.0, "groups": ()}
    stall = {"supply_v": 10.0, "peak_v": 11.0, "peak_a": Interval(estimate=1.0, low=0.9, high=1.2)}
    return OwnRecord.model_validate({**known, **stall, **changes})


def identified(drop: float) -> Any:
    return SimpleNamespace(
        resistance=Interval(estimate=4.0, low=3.8, high=4.2), drop=Interval.around(drop, 0.2)
    )


def test_shares_of_stall_are_currents_by_that_of_the_voltage_left() -> None:
    """10 V less a drop of 2 V over 4 Ω are 2 A; relative errors of 5 % and 0.2 V / 8 V add in squares."""
    friction = Interval(estimate=0.1, low=0.09, high=0.12)
    records = [record(), record(peak_a=Interval.around(0.5, 0.1))]
    told = present(motor.shares(records, identified(2.0), friction))
    error = (0.05**2 + 0.025**2) ** 0.5
    low, high = (0.1**2 + error**2) ** 0.5, (0.2**2 + error**2) ** 0.5
    assert [told.torque.estimate, told.torque.low, told.torque.high] == pytest.approx(
        [0.5, 0.5 * (1.0 - low), 0.5 * (1.0 + high)], abs=5e-5
    )
    # The level of the friction current is biased by a tenth besides.
    biased = (error**2 + 0.1**2) ** 0.5
    low, high = ((10.0 * away) ** 2 for away in (0.01, 0.02))
    share = present(told.friction)
    assert [share.estimate, share.low, share.high] == pytest.approx(
        [0.05, 0.05 * (1.0 - (low + biased**2) ** 0.5), 0.05 * (1.0 + (high + biased**2) ** 0.5)], abs=5e-6
    )
    assert motor.shares([record()], identified(2.0), None) == motor.Shares(None, told.torque)
    for drop, known in ((9.9, True), (10.0, False), (10.5, False)):
        assert (motor.shares([record()], identified(drop), None) is not None) is known
    for other in ("a", "zz"):
        assert motor.shares([record(equation=other)], identified(2.0), None) is None


@pytest.mark.parametrize(
    ("records", "why"),
    [
        ([record(), record()], None),
        ([record(), record(supply_v=12.0)], "the supply's voltage is not known"),
        ([record(supply_v=None)], "the supply's voltage is not known"),
        ([], "the supply's voltage is not known"),
        ([record(), record(peak_v=11.01)], "the motor had 11.01 V, more than the supply_voltage of 10 V"),
        ([record(peak_v=None)], None),
        ([record(), record(peak_a=None)], "the records do not contain the highest current"),
    ],
)
def test_what_the_shares_of_stall_lack(records: list[OwnRecord], why: str | None) -> None:
    told = motor.lacking(records)
    assert told is None if why is None else (told or "").startswith(why)
