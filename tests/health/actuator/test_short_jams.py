"""A jam of a few seconds is found with its beginning and its end, also when it frees itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums_sim.conditions import Condition
from tests.health.builders import samples
from tests.health.flown import Telemetry, actuator_of, flown, telemetry, watch

Array = NDArray[np.float64]
BARE = actuator_of().model_copy(update={"ema": None, "limits": None})


@pytest.mark.parametrize(
    ("start_s", "lasting_s", "rate_hz"),
    [(20.0, 1.5, 10.0), (23.37, 2.0, 50.0), (23.37, 3.0, 50.0), (21.2, 6.0, 50.0), (20.9, 8.0, 10.0)],
)
def test_a_short_jam_is_found_from_beginning_to_end(start_s: float, lasting_s: float, rate_hz: float) -> None:
    jam = Condition("jam", 10.0, 10.0, start_s, start_s + lasting_s)
    _, findings = watch(telemetry(flown(jam, rate_hz=rate_hz, seconds=60.0)))
    assert (findings.condition, findings.worst) == ("normal", "emergency")
    jams = [e for e in findings.evidence if e.kind == "jam" and e.rule.startswith("emergency")]
    assert len(jams) == 1
    assert jams[0].start_s == pytest.approx(start_s, abs=2.0)
    assert jams[0].end_s == pytest.approx(start_s + lasting_s, abs=2.0)


@pytest.mark.slow
@pytest.mark.parametrize("phase_s", np.arange(0.0, 1.0, 0.125).tolist())
@pytest.mark.parametrize("flown_deg", [0.1, 1.6])
def test_three_seconds_are_enough_whenever_they_begin(phase_s: float, flown_deg: float) -> None:
    """The shaft gives by up to a fifth of the 8° that are commanded; the profile knows nothing."""
    time_s = np.arange(0.0, 40.0, 0.04)
    held = (time_s >= 20.0 + phase_s) & (time_s < 23.0 + phase_s)
    command = 4.2 * np.sin(2.0 * np.pi * time_s / 1.7)
    start = command[held][0]
    angle = np.where(held, start + flown_deg * (command - start) / 8.4, command)
    _, findings = watch(Telemetry(time_s, samples(time_s.size, V1=command, V3=angle)), BARE)
    assert findings.worst == "emergency"


def test_a_pause_of_the_link_is_no_jam() -> None:
    """Command and shaft move and return while no sample comes."""
    time_s = np.arange(0.0, 40.0, 0.04)
    command = 8.0 * np.sin(2.0 * time_s)
    there = (time_s < 20.0) | (time_s > 22.2)
    angle = np.where((time_s > 19.9) & (time_s < 22.5), 0.0, command)
    values = samples(time_s.size, V1=command, V3=angle)
    _, findings = watch(Telemetry(time_s[there], values[there]), BARE)
    assert findings.worst == "undecided"


@pytest.mark.parametrize(
    ("share", "lasting_s", "worst"),
    [(0.95, 0.6, "emergency"), (0.95, 0.45, "undecided"), (0.7, 0.7, "undecided")],
)
@pytest.mark.parametrize("signed", [True, False])
def test_a_shaft_at_rest_at_stall_has_jammed(
    share: float, lasting_s: float, worst: str, *, signed: bool
) -> None:
    """It follows before and after, so that no longer time leaves out most of the command."""
    time_s, ema = np.arange(0.0, 30.0, 0.04), actuator_of().known_ema()
    current = share * 27.0 / ema.resistance * np.sign(np.sin(time_s))
    pushes = (time_s > 15.0) & (time_s < 15.0 + lasting_s)
    command = 8.0 * np.sin(time_s)
    values = samples(time_s.size, V1=command, V3=command)
    magnitudes = np.full((time_s.size, 3), np.nan)
    columns, there = (values, [4, 6]) if signed else (magnitudes, [1, 2])
    columns[:, there] = 0.0
    columns[pushes, there[0]] = current[pushes] if signed else np.abs(current[pushes])
    _, findings = watch(Telemetry(time_s, values, magnitudes=magnitudes))
    assert findings.worst == worst
