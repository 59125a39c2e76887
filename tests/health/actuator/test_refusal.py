"""The reasons why a flight shows no friction: each is forced by a flight of its own, and is the true one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.core.quantities import column
from mavhums.health.actuator.detectors.friction import FrictionDetector, why_no_friction
from mavhums.health.actuator.monitor import ActuatorFindings
from mavhums.health.estimation.equations import Fits
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums_sim.conditions import Condition
from tests.health.flown import Telemetry, actuator_of, flown, telemetry, watch
from tests.present import present

Array = NDArray[np.float64]
EMA = actuator_of().known_ema()
_V3, _V4, _V5, _V7, _V8, _V11 = (column(key) for key in ("V3", "V4", "V5", "V7", "V8", "V11"))


def judged(time_s: Array, values: Array) -> ActuatorFindings:
    return watch(Telemetry(time_s, values))[1]


def healthy(rate_hz: float = 50.0) -> tuple[Array, Array]:
    seen = telemetry(flown(rate_hz=rate_hz))
    return seen.time_s, seen.values


def code(findings: ActuatorFindings) -> str:
    assert findings.condition == "undecided"
    return present(findings.no_friction).code


SPEED = actuator_of().rad_s(1.0)


def one_way(values: Array) -> None:
    values[:, _V7] = np.abs(values[:, _V7]) + 100.0
    values[:, [_V4, _V11]] = np.nan


def unsigned(values: Array) -> None:
    values[:, [_V4, _V5, _V8]] = np.nan
    values[::400, _V5] = 0.1


def another_motor(values: Array) -> None:
    """Twice the back-EMF; a loss would be a verdict on the torque constant."""
    values[:, _V4] += EMA.gear_ratio * EMA.torque_constant * values[:, _V7] * SPEED


def below_zero(values: Array) -> None:
    values[:, [_V5, _V8]] -= np.sign(values[:, _V7])[:, None] * 0.2 * [1.0, EMA.torque_constant]
    values[:, _V4] = np.nan


def without_current(values: Array) -> None:
    values[:, [_V5, _V8, _V11]] = 0.0
    values[:, _V4] = np.nan


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda values: values[:, _V7].fill(0.0), "still"),
        (unsigned, "unsigned_current"),
        (one_way, "one_way"),
        (another_motor, "other_constant"),
        (below_zero, "negative_friction"),
        (without_current, "no_friction"),
    ],
)
def test_the_reason_is_what_the_flight_lacks(change: Callable[[Array], None], expected: str) -> None:
    time_s, values = healthy()
    assert judged(time_s, values).no_friction is None
    change(values)
    assert code(judged(time_s, values)) == expected


def test_its_telemetry_is_slow() -> None:
    time_s, values = healthy()
    few = judged(time_s[:800:40], values[:800:40])
    assert code(few) == "telemetry_too_slow"


@pytest.mark.parametrize("load_friction", [0.0, None])
def test_its_friction_is_too_uncertain(load_friction: float | None) -> None:
    time_s, values = healthy()
    rng = np.random.default_rng(4)
    values[:, _V5] += rng.normal(0.0, 4.0, time_s.size)
    values[:, _V8] = np.nan
    values[:, _V4] = np.nan
    actuator = actuator_of()
    ema = EMA.model_copy(update={"load_friction": load_friction})
    found = watch(Telemetry(time_s, values), actuator.model_copy(update={"ema": ema}))[1]
    assert code(found) == "friction_uncertain"


def test_its_telemetry_is_as_slow_as_the_profile_allows() -> None:
    time_s, values = healthy()
    one_way(values)
    fits, cutter = Fits(actuator_of(), FrictionDetector.equations), SlotCutter()
    slots = present(cutter.feed(time_s, with_extra_columns(values)))
    fits.feed(slots, motion(actuator_of(), slots))
    detector, least_hz = FrictionDetector(actuator_of()), actuator_of().min_rate_hz
    for rate_hz, expected in ((least_hz, "one_way"), (0.99 * least_hz, "telemetry_too_slow")):
        found = present(why_no_friction(detector, fits.whole(), moving=999, samples=999, rate_hz=rate_hz))
        assert found.code == expected


@pytest.mark.slow
@pytest.mark.parametrize("lost", [0.55, 0.7, 0.8, 0.9])
@pytest.mark.parametrize("rate_hz", [25.0, 100.0])
def test_a_lost_torque_constant_is_a_verdict_and_no_reason(lost: float, rate_hz: float) -> None:
    """No current shows a torque any more, so the friction is unknown; the loss itself is not."""
    _, findings = watch(telemetry(flown(Condition.constant("torque_constant", lost), rate_hz=rate_hz)))
    assert findings.condition in ("degraded", "emergency")
    assert "torque_constant" in [suspect.fault for suspect in findings.suspects]
    (shown,) = [one for one in findings.indicators if one.fault == "torque_constant"]
    assert shown.value.estimate == pytest.approx(lost, abs=0.06)
