"""A jam of a few seconds is told with its beginning and its end, also when it frees itself."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.core.quantities import KEYS
from mavhums_sim.conditions import Condition
from tests.health.builders import samples
from tests.health.flown import Telemetry, actuator_of, flown, telemetry, watch, watch_blocks
from tests.present import present

Array = NDArray[np.float64]
BARE = actuator_of().model_copy(update={"ema": None, "limits": None})


@pytest.mark.parametrize(
    ("start_s", "lasting_s", "rate_hz"),
    [(20.0, 1.5, 10.0), (23.37, 2.0, 50.0), (23.37, 3.0, 50.0), (21.2, 6.0, 50.0), (20.9, 8.0, 10.0)],
)
def test_a_short_jam_is_told_with_beginning_and_end(start_s: float, lasting_s: float, rate_hz: float) -> None:
    jam = Condition("jam", 10.0, 10.0, start_s, start_s + lasting_s)
    _, findings = watch(telemetry(flown(jam, rate_hz=rate_hz, seconds=60.0)))
    assert (findings.condition, findings.worst) == ("normal", "emergency")
    told = [e for e in findings.evidence if e.kind == "jam" and e.rule.startswith("emergency")]
    assert len(told) == 1
    assert told[0].start_s == pytest.approx(start_s, abs=2.0)
    assert told[0].end_s == pytest.approx(start_s + lasting_s, abs=2.0)


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


def unsigned(time_s: Array, moves: NDArray[np.bool_]) -> Telemetry:
    """Return a command of ±8°, and the magnitude of the speed of a shaft that follows it in some samples."""
    speed = np.abs(16.0 * np.cos(2.0 * time_s)) * actuator_of().known_ema().gear_ratio / 6.0
    magnitudes = np.full((time_s.size, 3), np.nan)
    magnitudes[:, 2] = np.where(moves, speed, 0.0)
    command = samples(time_s.size, V1=8.0 * np.sin(2.0 * time_s))
    return Telemetry(time_s, command, magnitudes=magnitudes)


NOTHING = np.isin(KEYS, ["V1"])


@pytest.mark.parametrize("rate_hz", [10.0, 25.0, 100.0])
def test_a_speed_without_sign_shows_a_shaft_that_cannot_have_moved(rate_hz: float) -> None:
    time_s = np.arange(0.0, 40.0, 1.0 / rate_hz)
    assert watch(unsigned(time_s, time_s > -1), measured=NOTHING)[1].worst == "undecided"
    held = (time_s > 20.0) & (time_s < 24.0)
    _, findings = watch(unsigned(time_s, ~held), measured=NOTHING)
    assert (findings.condition, findings.worst) == ("undecided", "emergency")


@pytest.mark.parametrize(("rattles", "condition"), [(0.25, "emergency"), (0.38, "undecided")])
def test_a_jam_lasts_while_a_rotor_rattles_in_its_gear(rattles: float, condition: str) -> None:
    """A speed without sign adds up to and fro: up to twice the commanded travel shows no motion."""
    time_s = np.arange(0.0, 60.0, 0.04)
    seen = unsigned(time_s, (time_s < 20.0) | (time_s > 24.0))
    present(seen.magnitudes)[time_s > 24.0] *= rattles
    _, findings = watch(seen, measured=NOTHING)
    assert (findings.condition, findings.worst) == (condition, "emergency")


def test_speeds_far_apart_show_no_jam() -> None:
    """The shaft may have moved between them."""
    time_s = np.arange(0.0, 40.0, 0.2)
    assert watch(unsigned(time_s, time_s < 0), measured=NOTHING)[1].worst == "undecided"


@given(cut=st.lists(st.integers(0, 1000), max_size=6).map(sorted))
@settings(max_examples=20, deadline=None)
def test_a_bound_of_the_travel_does_not_depend_on_the_blocks(cut: list[int]) -> None:
    time_s = np.arange(0.0, 40.0, 0.04)
    seen = unsigned(time_s, (time_s < 20.0) | (time_s > 24.0))
    whole = watch(seen, measured=NOTHING)[1].evidence
    assert whole
    parts = [seen.between(a, b) for a, b in itertools.pairwise([0, *cut, time_s.size])]
    assert watch_blocks(parts, measured=NOTHING)[1].evidence == whole


@pytest.mark.parametrize(
    ("share", "lasting_s", "worst"),
    [(0.95, 0.6, "emergency"), (0.95, 0.45, "undecided"), (0.7, 0.7, "undecided")],
)
@pytest.mark.parametrize("signed", [True, False])
def test_a_shaft_that_stands_at_stall_has_jammed(
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
