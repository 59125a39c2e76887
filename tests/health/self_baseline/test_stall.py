"""Friction and torque as shares of the torque at stall, of a servo whose torque at stall is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.estimation.equations.own_scale import POWER
from mavhums.health.estimation.flight_sums import collector
from mavhums.health.estimation.motor_identification import RESOLUTION, Peak, VoltageSums, identified
from mavhums.health.self_baseline.motor import (
    friction_current,
    stall_indicators,
)
from mavhums.health.self_baseline.verdict import compare_with_own_flights
from mavhums.results.verdict import STALL_SHARES, Interval, OwnRecord, Verdict
from tests.health.self_baseline.servo import NOISE_V, Array, Servo, blank, collected, left
from tests.present import present

SUPPLY_V = 27.0
SERVO = Servo(drop_v=3.0)
STALL_A = (SUPPLY_V - SERVO.drop_v) / SERVO.resistance
V4, V5, V7 = column("V4"), column("V5"), column("V7")


def supplied(volts: float | None = SUPPLY_V) -> Actuator:
    return blank().model_copy(update={"supply_voltage": volts})


def flown(seed: int, servo: Servo = SERVO) -> tuple[Array, Array, Array]:
    flight = servo.flown(seed, seconds=60.0)
    flight[1][:, V4] += NOISE_V * np.random.default_rng([seed, 4]).standard_normal(len(flight[0]))
    return flight


def voltage(seed: int, actuator: Actuator, cuts: tuple[int, ...] = ()) -> OwnRecord:
    return present(collected(VoltageSums(actuator), flown(seed), cuts))


def verdict(*own: OwnRecord) -> Verdict:
    return Verdict(vehicle=1, actuator="rudder", condition="undecided", worst="undecided", own=own)


def test_friction_and_torque_are_their_shares_of_a_known_stall() -> None:
    record = voltage(1, supplied())
    friction, torque = compare_with_own_flights(verdict(left(SERVO, 1, seconds=60.0), record), []).indicators[
        -2:
    ]
    assert (friction.fault, torque.fault) == STALL_SHARES
    assert friction.value.low <= SERVO.friction_a / STALL_A <= friction.value.high
    assert friction.value.estimate == pytest.approx(SERVO.friction_a / STALL_A, rel=0.05)
    peak = float(np.quantile(np.abs(flown(1)[1][:, V5]), 0.999))
    assert torque.value.estimate == pytest.approx(peak / STALL_A, rel=0.02)
    assert torque.value.low < torque.value.estimate < torque.value.high
    assert torque.unit == "1"


def test_without_friction_there_is_the_torque_alone() -> None:
    record = voltage(4, supplied())
    assert [one.fault for one in stall_indicators([record], identified([record]), None)] == [STALL_SHARES[1]]


def test_the_friction_of_flights_lies_inside_its_interval() -> None:
    records = [left(SERVO, seed, seconds=60.0) for seed in range(40, 60)]
    told = [friction_current(records[k : k + 2]) for k in range(0, 20, 2)]
    inside = [one is not None and one.low <= SERVO.friction_a <= one.high for one in told]
    assert sum(inside) >= 9


def test_the_peak_does_not_depend_on_the_cuts() -> None:
    assert voltage(9, supplied(), (1, 700, 701, 2500)) == voltage(9, supplied())


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1e9, 1e9, allow_subnormal=True), min_size=1, max_size=50), st.integers(0, 50))
def test_a_peak_is_one_of_the_values_in_any_order(values: list[float], cut: int) -> None:
    whole, pieces = Peak(), Peak()
    whole.feed(np.array(values))
    for piece in (values[cut:], values[:cut]):
        pieces.feed(np.array(piece))
    assert pieces.interval == whole.interval
    assert whole.interval.low <= whole.interval.estimate <= whole.interval.high
    highest = max(map(abs, values))
    assert whole.value == pytest.approx(highest if highest > 1.1e-4 else 0.0, rel=RESOLUTION, abs=1.1e-4)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from((0.0, -0.0, np.nan, np.inf, -np.inf, 1e300, 5e-324, 1e9)), st.integers(0, 2999))
def test_odd_values_never_make_an_odd_share(odd: float, sample: int) -> None:
    flight = flown(10)
    flight[1][sample :: max(sample, 1), [V4, V5, V7]] = odd
    record = collected(VoltageSums(supplied()), flight)
    found = identified([record]) if record else None
    for one in stall_indicators(
        [record] if record else [], found, Interval(estimate=0.05, low=0.04, high=0.06)
    ):
        assert np.isfinite([one.value.low, one.value.estimate, one.value.high]).all()
        assert 0.0 < one.value.estimate < 2.0


def test_the_supplys_power_cannot_tell_the_stall() -> None:
    """Two motors with the same R/k² take the same power and differ in their torque at stall."""
    records, stalls = [], []
    for scale in (1.0, 2.0):
        servo = Servo(resistance=20.0 * scale**2, back_emf=0.015 * scale, drop_v=0.0)
        time_s, values, airspeed = SERVO.flown(11, seconds=60.0)
        speed, torque = values[:, V7] * np.pi / 30, SERVO.back_emf * values[:, V5]
        power = servo.resistance * (torque / servo.back_emf) ** 2 + speed * torque
        values[:, V4], values[:, V5] = SUPPLY_V, power / SUPPLY_V
        actuator = supplied().model_copy(update={"esc_side": "bus"})
        flight = (time_s, values, airspeed)
        records.append(collected(collector(POWER, actuator), flight))
        stalls.append(SUPPLY_V / servo.resistance * servo.back_emf)
        assert collected(VoltageSums(actuator), flight) is None
    first, second = records
    assert first is not None
    assert second is not None
    assert np.array(second.groups) == pytest.approx(np.array(first.groups), rel=1e-6, abs=1e-9)
    assert stalls[0] == pytest.approx(2.0 * stalls[1])
