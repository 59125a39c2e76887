"""The battery of checks that every detector passes; a new detector is found and tested by itself.

It needs one line from its author: the flight in :data:`CLEAR` that it must find.
"""

from __future__ import annotations

import itertools
import warnings
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, Ema
from mavhums.core.quantities import KEYS, column
from mavhums.health.actuator.detectors import detectors_for
from mavhums.health.actuator.detectors.electrical import contradicts
from mavhums.health.decision.events import Indication
from mavhums_sim.conditions import Condition
from mavhums_sim.sensors import EscSide
from tests.health.builders import samples
from tests.health.flown import SURFACES, Telemetry, actuator_of, flown, telemetry, watch, watch_blocks
from tests.present import present
from tests.strategies import cuts

Array = NDArray[np.float64]
BUS = actuator_of(esc_side="bus")
DETECTORS = [detector.fault for detector in detectors_for(BUS)]


@dataclass(frozen=True, slots=True)
class Clear:
    """A condition that a detector must find, and the estimate that it must come to."""

    condition: Condition
    value: float
    within: float
    esc_side: EscSide = "motor"


CLEAR = {
    "backlash": Clear(Condition.constant("backlash", 0.3), 0.38, 0.05),
    "following": Clear(Condition.constant("supply_sag", 25.0), 8.0, 3.0),
    "friction": Clear(Condition.constant("friction", 0.6), 0.82, 0.06),
    "jam": Clear(Condition.constant("jam", 10.0), 1.0, 0.05),
    "sensor_bias": Clear(Condition.constant("sensor_bias", 0.8), 0.8, 0.05),
    "supply_sag": Clear(Condition.constant("supply_sag", 6.0), 6.0, 0.3, "bus"),
    "torque_constant": Clear(Condition.constant("torque_constant", 0.15), 0.19, 0.05),
    "winding_resistance": Clear(Condition.constant("resistance", 0.25), 1.25 * 22.6457, 0.5),
}

HEALTHY = [
    ("gusts", 100.0, "motor", 1),
    ("takeoff", 25.0, "motor", 2),
    ("turns", 100.0, "bus", 3),
    ("landing", 25.0, "bus", 4),
    ("cruise", 25.0, "motor", 5),
    ("preflight", 100.0, "motor", 6),
]


@pytest.mark.parametrize("fault", DETECTORS)
class TestEvery:
    """What is asked of each detector by itself."""

    def test_finds_the_clear_fault_and_names_it_alone(self, fault: str) -> None:
        case = CLEAR[fault]
        for rate_hz in (100.0, 25.0):
            record = flown(case.condition, rate_hz=rate_hz, esc_side=case.esc_side)
            events, findings = watch(telemetry(record), actuator_of(esc_side=case.esc_side))
            # What is wrong may be found beside what follows from it.
            named = {suspect.fault: suspect.confidence for suspect in findings.suspects}
            assert {fault} <= set(named) <= {fault, case.condition.fault}
            assert named[fault] > 0.99
            assert findings.condition in ("degraded", "emergency")
            assert any(e.kind == fault and e.value > 0 for e in findings.evidence)
            shown = [e for e in events if isinstance(e, Indication) and e.fault == fault]
            values = np.concatenate([np.abs(e.value) for e in shown])
            assert np.median(values) == pytest.approx(case.value, abs=case.within)

    def test_is_silent_before_the_fault_and_speaks_after_it(self, fault: str) -> None:
        case = CLEAR[fault]
        step = Condition.step(case.condition.fault, case.condition.start, 40.0)
        record = flown(step, rate_hz=25.0, seconds=80.0, esc_side=case.esc_side)
        _, findings = watch(telemetry(record), actuator_of(esc_side=case.esc_side))
        grave = [e for e in findings.evidence if e.kind == fault and not e.rule.startswith("normal")]
        assert grave[0].start_s == pytest.approx(40.0, abs=10.0)
        assert fault in [suspect.fault for suspect in findings.suspects]

    def test_does_not_depend_on_the_blocks(self, fault: str) -> None:
        case = CLEAR[fault]
        seen = telemetry(flown(case.condition, rate_hz=25.0, esc_side=case.esc_side))
        whole = watch(seen, BUS.model_copy(update={"esc_side": case.esc_side}))[1]
        for places in ([1], [100, 101, 102, 500], list(range(7, 1000, 37))):
            parts = [seen.between(a, b) for a, b in itertools.pairwise([0, *places, seen.time_s.size])]
            found = watch_blocks(parts, BUS.model_copy(update={"esc_side": case.esc_side}))[1]
            assert (found.evidence, found.indicators) == (whole.evidence, whole.indicators)


@pytest.mark.parametrize(("cyclogram", "rate_hz", "side", "seed"), HEALTHY)
@pytest.mark.parametrize("esc", [False, True], ids=["instrumented", "esc-signed"])
def test_healthy_individuals_alarm_no_detector(
    cyclogram: str, rate_hz: float, side: EscSide, seed: int, esc: bool
) -> None:
    record = flown(
        cyclogram=cyclogram, rate_hz=rate_hz, seconds=100.0, seed=seed, individuals=500 + seed, esc_side=side
    )
    decided = 0
    for surface in SURFACES:
        seen = telemetry(record, surface, esc=esc)
        _, findings = watch(seen, actuator_of(surface, esc_side=side))
        assert findings.suspects == ()
        assert findings.worst in ("normal", "undecided")
        decided += findings.condition == "normal"
    assert decided >= (0 if cyclogram == "cruise" else 3)


ABSURD = st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e12, 1e9, 9.9e8, -9.9e8, 1e-308, 0.0])


@pytest.mark.slow
@given(
    kinds=st.lists(
        st.tuples(st.integers(0, 12), ABSURD, st.integers(0, 999), st.integers(1, 1000)), max_size=12
    ),
    places=cuts(1000),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.differing_executors])
def test_absurd_numbers_raise_nothing(kinds: list[tuple[int, float, int, int]], places: list[int]) -> None:
    """A log may hold any number; detectors neither raise nor warn, and all they say is finite."""
    seen = telemetry(flown(rate_hz=25.0, esc_side="bus"))
    values, bus_v = seen.values.copy(), present(seen.bus_v).copy()
    for place, number, first, count in kinds:
        target = bus_v if place == 12 else values[:, place]
        target[first : first + count] = number
    absurd = Telemetry(seen.time_s, values, bus_v)
    blocks = [absurd.between(a, b) for a, b in itertools.pairwise([0, *places, 1000])]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        events, findings = watch_blocks(blocks, BUS)
    for event in events:
        if isinstance(event, Indication):
            assert np.isfinite([event.value, event.low, event.high]).all()
    for suspect in findings.suspects:
        assert 0 <= suspect.confidence <= 1


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 0.0, 1e308, 1e12])
def test_nothing_comes_of_nothing(number: float) -> None:
    time_s = np.arange(0.0, 40.0, 0.04)
    values = np.full((time_s.size, 12), number)
    _, findings = watch(Telemetry(time_s, values, np.full(time_s.size, np.nan)), BUS)
    assert findings.condition == findings.worst == "undecided"
    assert findings.suspects == ()
    assert findings.evidence == ()


def test_a_gear_is_judged_only_by_angles_that_sensors_gave() -> None:
    """A rotor angle that was integrated, or an output angle that was divided, shows no play and no bias."""
    seen = telemetry(flown(Condition.constant("backlash", 0.3), rate_hz=25.0))
    for missing in (1, 2):
        measured = np.ones(12, dtype=bool)
        measured[missing] = False
        _, findings = watch(seen, measured=measured)
        assert findings.suspects == ()
        assert not {"backlash", "sensor_bias"} & {indicator.fault for indicator in findings.indicators}


def test_an_angle_of_guessed_sign_shows_no_jam() -> None:
    seen = telemetry(flown(Condition.constant("jam", 10.0), rate_hz=25.0))
    measured = np.ones(12, dtype=bool)
    measured[[1, 2]] = False
    assert [s.fault for s in watch(seen, measured=measured)[1].suspects] == ["jam"]
    measured[6] = False
    seen.values[:, [column("V5"), column("V8")]] = np.nan  # the current at stall is evidence of its own
    assert watch(seen, measured=measured)[1].suspects == ()


def test_a_jam_shows_in_light_air() -> None:
    """Where three seconds command too little travel, ten command enough."""
    record = flown(Condition.constant("jam", 10.0), rate_hz=25.0, seconds=100.0, cyclogram="cruise")
    _, findings = watch(telemetry(record))
    assert [suspect.fault for suspect in findings.suspects] == ["jam"]


@pytest.mark.parametrize(("flown_deg", "jammed"), [(0.7, True), (1.6, False), (3.0, False)])
def test_a_rotor_that_winds_up_its_gear_moves_no_surface(flown_deg: float, jammed: bool) -> None:
    """An angle divided from the rotor's shows what the gear gives, too; a sensor's at the shaft does not."""
    time_s = np.arange(0.0, 30.0, 0.04)
    command = 3.0 * np.sin(2.0 * time_s)
    angle = np.clip(command, -flown_deg, flown_deg)
    values = samples(time_s.size, V1=command, V3=angle, V7=np.gradient(angle, time_s) * 50.0)
    rotors, sensors = np.isin(KEYS, ["V1", "V7"]), np.isin(KEYS, ["V1", "V3", "V7"])
    found = [watch(Telemetry(time_s, values), measured=measured)[1] for measured in (rotors, sensors)]
    assert [bool(findings.suspects) for findings in found] == [jammed, False]


_SERVO = Ema(gear_ratio=100.0, torque_constant=0.012, resistance=3.0, inertia=1e-8)


@given(st.floats(0.3, 4.0), st.floats(0.3, 0.9), st.floats(0.0, 0.03))
def test_a_servo_too_weak_for_its_load_is_not_jammed(gain: float, reach: float, friction: float) -> None:
    """A P-controller without inertia under a pendulum that it cannot lift, and the same without it, jammed.

    ``gain`` in supplies per radian, ``reach`` the torque at stall by that of the load at 90°, ``friction`` in
    radians that the controller needs to overcome it.
    """
    bare = Actuator(name="servo", servo=1, pwm_us=(1000, 1500, 2000), ema=_SERVO)
    found = {}
    for jams in (False, True):
        time_s, values, angle = np.arange(0.0, 30.0, 0.01), np.full((3000, 12), np.nan), 0.0
        command = np.pi / 2 * np.sin(0.25 * time_s) ** 2 * (1.0 if not jams else 0.15)
        for k, wanted in enumerate(command):
            drive = np.clip(gain * (wanted - angle), -1.0, 1.0) - (0.0 if jams else np.sin(angle) / reach)
            speed = 5.0 * np.sign(drive) * max(abs(drive) - gain * friction, 0.0)
            speed *= not (jams and time_s[k] > 8.0)
            angle += 0.01 * speed
            volts = 6.0 * np.clip(gain * (wanted - angle), -1.0, 1.0)
            values[k, [0, 2, 3, 6]] = *np.degrees([wanted, angle]), volts, speed * 3000.0 / np.pi
        found[jams] = [one.fault for one in watch(Telemetry(time_s, values), actuator=bare)[1].suspects]
    assert found == {False: [], True: ["jam"]}


def test_a_jam_leaves_the_friction_undecided() -> None:
    _, findings = watch(telemetry(flown(Condition.constant("jam", 10.0), rate_hz=100.0)))
    assert findings.friction is None
    assert findings.coverage.decidable > 0
    assert findings.condition == "emergency"


def test_a_profile_that_says_little_leaves_the_jam_alone() -> None:
    bare: Actuator = actuator_of().model_copy(update={"ema": None, "limits": None})
    assert [detector.fault for detector in detectors_for(bare)] == ["jam"]
    open_limits = actuator_of().model_copy(update={"limits": None})
    faults = [detector.fault for detector in detectors_for(open_limits)]
    assert "friction" not in faults
    assert {"jam", "torque_constant"} <= set(faults)


@pytest.mark.parametrize(
    ("share", "error", "surely"),
    [
        (0.51, 0.01, False),
        (0.50, 0.01, True),
        (1.49, 0.01, False),
        (1.50, 0.01, True),
        (0.2, 0.199, True),
        (0.2, 0.2, False),
    ],
)
def test_a_constant_contradicts_the_data_sheet_when_half_of_it_is_surely_missing_or_too_much(
    share: float, error: float, surely: bool
) -> None:
    """The back-EMF of the output shaft is the motor's constant times the gear ratio."""
    ema = actuator_of().known_ema().model_copy(update={"torque_constant": 0.5, "gear_ratio": 8.0})
    fit: Any = SimpleNamespace(corrected=lambda *_, **__: (np.array([4.0 * share]), np.array([4.0 * error])))
    found, shown = contradicts(fit, ema, turned=False)
    assert found.tolist() == [surely]
    assert shown.tolist() == [share]


@pytest.mark.parametrize("seed", [2, 4])
def test_the_motors_voltage_shows_the_supply_where_the_shaft_lags(seed: int) -> None:
    sag, measured = Condition.constant("supply_sag", 20.0), np.ones(12, dtype=bool)
    seen = telemetry(flown(sag, rate_hz=25.0, cyclogram="takeoff", seconds=100.0, seed=seed))
    (shown,) = [one for one in watch(seen)[1].indicators if one.fault == "supply_sag"]
    assert shown.value.estimate == pytest.approx(20.0, abs=0.3)
    # An angle that no sensor measured drifts away from any command.
    measured[2] = False
    assert "supply_sag" not in [one.fault for one in watch(seen, measured=measured)[1].indicators]


@pytest.mark.parametrize(("fault", "severity"), [("friction", 2.0), ("sensor_bias", 10.0), ("jam", 5.0)])
def test_no_other_fault_is_blamed_on_the_supply(fault: str, severity: float) -> None:
    for cyclogram in ("takeoff", "gusts"):
        record = flown(Condition.constant(fault, severity), rate_hz=25.0, cyclogram=cyclogram)
        _, findings = watch(telemetry(record))
        assert "supply_sag" not in [suspect.fault for suspect in findings.suspects]
