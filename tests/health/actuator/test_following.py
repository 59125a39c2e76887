"""A shaft that moves, but not as commanded."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.core.quantities import column
from mavhums_sim.conditions import Condition
from tests.health.builders import samples
from tests.health.flown import Telemetry, actuator_of, flown, telemetry, watch

Array = NDArray[np.float64]
_V3 = column("V3")
NO_CONSTANTS = actuator_of().model_copy(update={"ema": None})


def servo(command: Array, time_s: Array, *, slew_deg_s: float, lag_s: float = 0.05) -> Array:
    """Return what an ideal servo flies, in steps of a millisecond."""
    fine = np.arange(time_s[0], time_s[-1], 0.001)
    asked, angle, shaft = np.interp(fine, time_s, command), np.empty(fine.size), 0.0
    for k in range(fine.size):
        speed = np.clip((asked[k] - shaft) / lag_s, -slew_deg_s, slew_deg_s)
        shaft += 0.001 * float(speed)
        angle[k] = shaft
    return np.interp(time_s, fine, angle)


def flight(slew_deg_s: float, amplitude_deg: float, period_s: float) -> Telemetry:
    time_s = np.arange(0.0, 40.0, 0.02)
    command = amplitude_deg * np.sin(2 * np.pi * time_s / period_s)
    angle = servo(command, time_s, slew_deg_s=slew_deg_s)
    return Telemetry(time_s, samples(time_s.size, V1=command, V3=angle))


@pytest.mark.slow
@given(amplitude_deg=st.floats(0.0, 60.0), period_s=st.floats(0.7, 20.0), slew=st.floats(100.0, 400.0))
@settings(max_examples=15, deadline=None)
def test_no_command_makes_a_healthy_servo_fall_behind(
    amplitude_deg: float, period_s: float, slew: float
) -> None:
    """However fast the command, at its slew rate an actuator follows; one that is faster follows better."""
    if slew > 110.0:  # then the command must not ask for more than the data sheet's rate
        period_s = max(period_s, 2 * np.pi * amplitude_deg / 100.0)
    _, findings = watch(flight(slew, amplitude_deg, period_s), NO_CONSTANTS)
    assert findings.worst == "undecided"
    assert findings.suspects == ()


@pytest.mark.parametrize(
    ("slew_deg_s", "worst"), [(100.0, "undecided"), (45.0, "degraded"), (20.0, "emergency")]
)
def test_a_slow_shaft_falls_behind_without_any_constant_of_its_motor(slew_deg_s: float, worst: str) -> None:
    """±15° in 1.2 s ask for up to 79 °/s."""
    _, findings = watch(flight(slew_deg_s, 15.0, 1.2), NO_CONSTANTS)
    assert findings.worst == worst
    assert [suspect.fault for suspect in findings.suspects] == ["following"] * (worst != "undecided")


def test_a_shaft_that_moves_without_a_command_does_not_follow_it() -> None:
    """A servo that jitters by 4° to either side of a held command, three times a second."""
    seen = flight(100.0, 0.0, 1.2)
    assert watch(seen, NO_CONSTANTS)[1].worst == "undecided"
    seen.values[:, _V3] = 4.0 * np.sin(2 * np.pi * 3.0 * seen.time_s)
    findings = watch(seen, NO_CONSTANTS)[1]
    assert (findings.worst, [suspect.fault for suspect in findings.suspects]) == ("degraded", ["following"])


@pytest.mark.parametrize(("slew_deg_s", "worst"), [(100.0, "undecided"), (20.0, "emergency")])
def test_an_angle_that_drifts_shows_the_lag_within_a_second(slew_deg_s: float, worst: str) -> None:
    seen, measured = flight(slew_deg_s, 15.0, 1.2), np.ones(12, dtype=bool)
    seen.values[:, _V3] += 9.0 + 0.1 * seen.time_s
    measured[_V3] = False
    assert watch(seen, NO_CONSTANTS, measured=measured)[1].worst == worst


@pytest.mark.parametrize("cyclogram", ["takeoff", "gusts"])
@pytest.mark.parametrize("lost_v", [23.0, 25.0])
def test_a_weak_supply_is_found_without_its_voltage(lost_v: float, cyclogram: str) -> None:
    """With 2 V left the shaft may rest against the load for seconds, which is a jam as well."""
    seen = telemetry(flown(Condition.constant("supply_sag", lost_v), cyclogram=cyclogram, seconds=60.0))
    seen.values[:, column("V4")] = np.nan
    _, findings = watch(seen)
    assert findings.worst in ("degraded", "emergency")
    assert {suspect.fault for suspect in findings.suspects} - {"jam"} == {"following"}


def test_one_wrong_second_is_no_fault() -> None:
    seen = flight(100.0, 15.0, 1.2)
    seen.values[1000:1050, _V3] += 40.0
    assert watch(seen, NO_CONSTANTS)[1].worst == "undecided"
