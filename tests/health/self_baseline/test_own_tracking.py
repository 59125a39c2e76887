"""Servos that measure only command and angle, against their own flights: a weak supply, a slow controller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.core.quantities import KEYS
from mavhums.health.estimation.equations.own_scale import LAG, TRACKING
from mavhums.health.estimation.flight_sums import OwnSums
from mavhums.health.estimation.wear import wear
from mavhums.health.self_baseline.comparison import compare
from mavhums.health.self_baseline.past import record_of
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import OwnRecord
from mavhums_sim import Flight, fly
from mavhums_sim.conditions import Condition
from mavhums_sim.link import Link
from mavhums_sim.telemetry import write_tlog
from tests.conftest import Run
from tests.health.builders import samples
from tests.health.flown import flown
from tests.health.self_baseline.servo import blank, collected, past
from tests.present import present


def left(seed: int, *conditions: Condition) -> OwnRecord:
    """Return what a flight leaves of a servo that measures command and angle."""
    seen = flown(*conditions, cyclogram="gusts", seconds=60.0, seed=seed)["elevator"]
    values = np.where(np.isin(KEYS, ["V1", "V3"]), seen.values, np.nan)
    return present(collected(OwnSums(TRACKING, blank()), (seen.time_s, values, None)))


@pytest.mark.slow
def test_a_weak_supply_is_changed_against_the_servos_own_flights() -> None:
    """At 20 V of 27 V lost the shaft falls behind now and then, at 24 V all the time."""
    before = past(*(left(7100 + k) for k in range(20)))
    assert compare(TRACKING, left(7200), before).condition == "unchanged"
    for lost_v in (20.0, 22.0, 24.0):
        weak = left(7200, Condition.constant("supply_sag", lost_v))
        assert compare(TRACKING, weak, before).condition == "changed"


@given(st.floats(0.02, 0.3), st.floats(0.0, 1.5), st.floats(3.0, 20.0))
def test_the_lag_is_the_controllers_whatever_the_friction(lag: float, stuck: float, size: float) -> None:
    """The command is what a proportional controller needs to move its shaft so: V1 = V3 + lag·w + e·sgn w."""
    time_s = np.arange(0.0, 80.0, 0.02)
    angle = size * (np.sin(0.9 * time_s) + 0.4 * np.sin(2.3 * time_s + 1.0))
    speed = size * (0.9 * np.cos(0.9 * time_s) + 0.92 * np.cos(2.3 * time_s + 1.0))
    values = samples(time_s.size, V1=angle + lag * speed + stuck * np.sign(speed), V3=angle)
    sums = present(collected(OwnSums(TRACKING, blank()), (time_s, values, None)))
    record = present(record_of([sums], LAG.name))
    found = present(wear(record, None))
    assert found.value == pytest.approx(lag, rel=0.02)


@pytest.mark.slow
def test_a_slow_controller_is_told_from_friction_by_the_flights_before(run: Run, tmp_path: Path) -> None:
    """Logs of servos that report command and angle alone, through the command and its store."""
    store, log = tmp_path / "flights.db", tmp_path / "flight.tlog"
    blanks = "".join(
        f'[[actuators]]\nname = "{name}"\nservo = {servo}\npwm_us = [1000, 1500, 2000]\n'
        for servo, name in enumerate(("aileron_left", "aileron_right", "elevator", "rudder"), 1)
    )
    profile = tmp_path / "blank.toml"
    profile.write_text(f'name = "blank"\n{blanks}', encoding="utf-8")

    def judged(seed: int, *conditions: Condition) -> dict[str, set[str]]:
        flight = Flight(
            seed=seed, duration_s=60.0, rate_hz=50.0, cyclogram="gusts", tiers=("position", "pwm"),
            conditions={"elevator": conditions},
        )  # fmt: skip
        write_tlog(fly(flight), log, Link(day=seed - 300))
        told = run("analyse", str(log), "--airframe", str(profile), "--store", str(store), "--keep", "--json")
        verdicts = Assessment.model_validate_json(told.out).verdicts
        return {v.actuator: {s.fault for s in v.suspects} for v in verdicts if v.subject == "actuator"}

    for k in range(20):
        judged(300 + k)
    assert not any(judged(340).values())
    slow = judged(341, Condition.constant("slow", 0.3))
    assert "lag" in slow.pop("elevator")
    assert not any(slow.values())
    assert judged(342, Condition.constant("friction", 0.2))["elevator"] == {"tracking"}
