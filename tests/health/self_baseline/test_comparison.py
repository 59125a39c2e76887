"""Comparisons of estimates that are known exactly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mavhums.health.estimation.motor_identification import VOLTAGE
from mavhums.health.estimation.random_effects import population, variance_between
from mavhums.health.estimation.thresholds import NATURAL_SCATTER_FREEDOM, WINDOW_S
from mavhums.health.self_baseline import motor
from mavhums.health.self_baseline.comparison import _ReferenceFlights, _windows
from mavhums.results.standing import Interval
from mavhums.results.verdict import OwnRecord


def test_a_share_of_a_variance_is_as_uncertain_as_both(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavhums.health.self_baseline.comparison.information", lambda record: 7.0)
    asked: list[Any] = []

    def with_own(*given: float) -> tuple[float, float]:
        asked.extend(given)
        return 0.04, 10.0

    reference: Any = SimpleNamespace(common=SimpleNamespace(with_own=with_own), shared=(0.5, 30.0))
    own_wear: Any = SimpleNamespace(freedom=3.0)
    record: Any = None
    assert _ReferenceFlights._own(reference, 0.2, own_wear, record) == pytest.approx((0.02, 7.5))
    assert asked == pytest.approx([0.04, 3.0, 7.0])


def test_a_flight_has_a_window_at_least() -> None:
    record: Any = SimpleNamespace(duration_s=2.5 * WINDOW_S)
    assert _windows(record) == 2.5
    record.duration_s = 0.5 * WINDOW_S
    assert _windows(record) == 1.0


def back_emf(low: float, high: float) -> Any:
    return SimpleNamespace(back_emf=Interval(estimate=(low + high) / 2, low=low, high=high))


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
    told = motor.shares([record(), record(peak_a=Interval.around(0.5, 0.1))], identified(2.0), friction)
    assert told is not None
    error = (0.05**2 + 0.025**2) ** 0.5
    low, high = (0.1**2 + error**2) ** 0.5, (0.2**2 + error**2) ** 0.5
    assert [told.torque.estimate, told.torque.low, told.torque.high] == pytest.approx(
        [0.5, 0.5 * (1.0 - low), 0.5 * (1.0 + high)], abs=5e-5
    )
    # The level of the friction current is biased by a tenth besides.
    biased = (error**2 + 0.1**2) ** 0.5
    low, high = ((10.0 * away) ** 2 for away in (0.01, 0.02))
    assert told.friction is not None
    assert [told.friction.estimate, told.friction.low, told.friction.high] == pytest.approx(
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


@pytest.mark.parametrize(("parts", "times"), [(1, 12.706), (2, 12.706), (10, 2.262)])
def test_the_scatter_of_parts_follows_from_the_interval_of_their_mean(parts: int, times: float) -> None:
    """Half an interval is the error times t of one degree of freedom less than there are parts."""
    value = Interval(estimate=1.0, low=0.9, high=1.3)
    earlier = [Interval.around(1.0 + 0.01 * k, 0.1) for k in range(9)]
    shown = motor._indicator("fault", "quantity", "Ω", value, earlier, parts)
    assert shown.scatter == pytest.approx(0.2 / times * parts**0.5, rel=1e-3)
    assert (shown.value, shown.windows, shown.baseline, shown.baseline_flights) == (value, parts, None, 9)


@pytest.mark.parametrize(
    ("now", "rise", "least", "lost"),
    [
        ((0.88, 0.92), 1 / 0.9 - 1, 0.05, 0.10),  # the same torque by more current
        ((0.88, 0.92), 0.30, 0.05, None),  # the friction rose as well
        ((0.88, 0.92), 0.14, 0.05, 0.10),  # 1.14 · 0.9: it rose by 2.6 %, less than is detected
        ((0.88, 0.92), 0.14, 0.02, None),
        ((0.88, 0.92), 0.20, 0.50, 0.10),  # 8 % is less than half the change
        ((0.88, 0.92), 0.26, 0.50, None),  # 13.4 % is more than half of it
        ((0.94, 0.98), 1 / 0.96 - 1, 0.05, 0.04),
        ((0.96, 0.982), 0.03, 0.05, None),  # 2.9 % lost is too little to be told
        ((0.94, 0.990), 0.03, 0.05, None),  # the intervals meet
        ((1.08, 1.12), 0.0, 0.05, None),
    ],
)
def test_a_constant_that_fell_explains_a_current_that_rose(
    monkeypatch: pytest.MonkeyPatch, now: tuple[float, float], rise: float, least: float, lost: float | None
) -> None:
    """The constant was 0.99 to 1.01 of the same unit in the earlier flights."""
    monkeypatch.setattr(motor, "record_of", lambda records, equation: records)
    estimates = {"now": back_emf(*now), "before": back_emf(0.99, 1.01)}
    monkeypatch.setattr(motor, "identified", lambda records: estimates[records[0]])
    change = Interval(estimate=rise, low=rise, high=rise)
    found: Any = SimpleNamespace(change=change, least_rise=least)
    past: Any = [SimpleNamespace(healthy=one == "before", records=one) for one in ("worn", "before")]
    current: Any = "now"
    told = motor.constant_lost(found, current, past)
    assert told == (None if lost is None else pytest.approx(lost))
    for name in estimates:
        known = estimates | {name: None}
        monkeypatch.setattr(motor, "identified", lambda records, known=known: known[records[0]])
        assert motor.constant_lost(found, current, past) is None
    found.change = None
    assert motor.constant_lost(found, current, past) is None


def test_flights_that_agree_scatter_as_actuators_do_about_their_weighted_mean() -> None:
    """One flight that is far off and hardly known moves neither the mean nor the natural scatter."""
    values, errors = np.append(np.full(10, 2.0), 100.0), np.append(np.full(10, 0.01), 1e6)
    found = population(np.ones((11, 1)), values, errors, natural_scatter=0.1)
    own = variance_between(np.ones((11, 1)), values, errors)
    natural = NATURAL_SCATTER_FREEDOM * (0.1 * 2.0) ** 2
    variance = (natural + 10 * own) / (NATURAL_SCATTER_FREEDOM + 10)
    assert found.between == pytest.approx(variance**0.5, rel=1e-3)
    assert float(found.coefficients[0]) == pytest.approx(2.0, rel=1e-4)
