"""One actuator through a flight, on samples made by the simulator and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.actuator import load_airframe
from mavhums.events import ConditionChanged, Window
from mavhums.health import Monitor
from mavhums.health.monitor import Findings
from mavhums.learn import default_model
from mavhums_sim import Flight, fly

ACTUATOR = load_airframe("paper").actuators[2]
Array = NDArray[np.float64]


def flown(
    friction: tuple[float, float], *, seconds: float = 30.0, rate_hz: float = 100.0
) -> tuple[Array, Array]:
    flight = Flight(seed=41, duration_s=seconds, rate_hz=rate_hz, friction_nm={"elevator": friction})
    record = fly(flight).actuators["elevator"]
    return record.time_s, record.values


def watch(time_s: Array, values: Array) -> tuple[list[Window], Findings]:
    monitor = Monitor(1, ACTUATOR)
    events = [*monitor.feed(time_s, values), *monitor.finish()]
    return [event for event in events if isinstance(event, Window)], monitor.findings()


@pytest.mark.parametrize("rate_hz", [100.0, 50.0, 25.0])
def test_friction_is_found_at_any_rate(rate_hz: float) -> None:
    windows, findings = watch(*flown((0.3, 0.3), rate_hz=rate_hz))
    assert len(windows) == 21
    assert findings.condition == "normal"
    assert findings.friction is not None
    assert findings.friction.estimate == pytest.approx(0.3, abs=0.02)


def test_what_is_found_is_held_through_standstill() -> None:
    time_s, values = flown((1.0, 1.0))
    still = time_s > 18.0
    values[still, 6] = 0.0
    windows, findings = watch(time_s, values)
    assert windows[-1].friction_nm is None
    assert windows[-1].condition == "emergency"
    assert findings.condition == "emergency"
    assert findings.coverage.decidable < findings.coverage.windows
    assert findings.friction is not None


def test_seconds_without_samples_end_no_window_twice() -> None:
    time_s, values = flown((0.3, 0.3))
    there = (time_s < 12.0) | (time_s > 16.0)
    windows, findings = watch(time_s[there], values[there])
    ends = [window.end_s for window in windows]
    assert ends == sorted(set(ends))
    assert findings.condition == "normal"


def test_a_lone_sample_is_no_second() -> None:
    _, findings = watch(np.array([0.5]), np.zeros((1, 12)))
    assert findings.coverage.windows == 0
    assert findings.condition == "undecided"
    assert findings.last_s == 0.5


def test_an_interval_wider_than_the_limits_are_apart_decides_nothing() -> None:
    time_s, values = flown((0.3, 0.3))
    values[:, 7] += np.random.default_rng(0).normal(0.0, 0.05, time_s.size)
    windows, findings = watch(time_s, values)
    assert findings.coverage.decidable < len(windows)
    assert all(w.friction_nm is None or w.friction_nm.high - w.friction_nm.low <= 0.5 for w in windows)


def test_network_and_friction_are_shown_side_by_side_and_disagreement_is_said() -> None:
    network = default_model().network

    class Contrary:
        def p_emergency(self, values: Array) -> Array:
            return 1.0 - network.p_emergency(values)

        def inside(self, values: Array) -> NDArray[np.bool_]:
            return network.inside(values)

    time_s, values = flown((0.225, 0.225))
    for judge, disagrees in ((network, False), (Contrary(), True)):
        monitor = Monitor(1, ACTUATOR, judge)
        changes = [e for e in monitor.feed(time_s, values) if isinstance(e, ConditionChanged)]
        findings = monitor.findings()
        assert [change.after for change in changes] == ["normal"]
        assert findings.condition == "normal"
        vote = next(e for e in findings.evidence if e.kind == "network")
        assert ("disagrees" in vote.rule) == disagrees
        assert (vote.value > 0.5) == disagrees


def test_the_suspect_is_friction_with_its_probability() -> None:
    _, findings = watch(*flown((0.6, 0.6)))
    assert [suspect.fault for suspect in findings.suspects] == ["friction"]
    assert findings.suspects[0].confidence > 0.99
    assert watch(*flown((0.3, 0.3)))[1].suspects == ()


def test_a_condition_that_flaps_for_hours_fills_no_memory() -> None:
    """Worn and sound by turns of 25 s: the first and the latest stays are told."""
    turns = [flown((friction, friction), seconds=25.0, rate_hz=20.0) for friction in (0.225, 1.0)]
    monitor = Monitor(1, ACTUATOR)
    changes = 0
    for k in range(130):
        time_s, values = turns[k % 2]
        events = monitor.feed(time_s + 25.0 * k, values)
        changes += sum(isinstance(event, ConditionChanged) for event in events)
    stays = [evidence for evidence in monitor.findings().evidence if evidence.kind == "friction"]
    assert changes > 120
    assert len(stays) == 100
    assert stays[0].start_s == 0.0
    assert stays[-1].end_s > 25.0 * 129
