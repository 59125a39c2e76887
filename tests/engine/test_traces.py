"""What lies behind a judgement: the evidence reaches an alarm's where, and only where, one is raised."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY
from mavhums.health.decision.events import ConditionChanged, Trace
from mavhums_sim.rover import SteeringFault, encoded
from tests.engine.test_steering import driven
from tests.engine.wired import Wired
from tests.health.motor.test_monitor import log
from tests.judge import judged


def traced(content: bytes, **options: Any) -> tuple[dict[tuple[str, str], Array], list[ConditionChanged]]:
    """Return time, comparison and value of each trace, and the alarms by what it shows."""
    _, events = judged(content, vehicle_states=True, **options)
    parts: dict[tuple[str, str], list[Array]] = {}
    for event in events:
        if isinstance(event, Trace):
            rows = np.column_stack([event.time_s, event.values])
            parts.setdefault((event.actuator, event.kind), []).append(rows)
    changes = [event for event in events if isinstance(event, ConditionChanged)]
    alarms = [change for change in changes if SEVERITY[change.after] > SEVERITY["normal"]]
    return {key: np.concatenate(rows) for key, rows in parts.items()}, alarms


def hovered(loss: float) -> bytes:
    """The log of a quadrotor of whose motors one loses a part of its thrust."""
    with TemporaryDirectory() as folder:
        return log(Path(folder) / "log.tlog", "quad x", loss, seed=4).read_bytes()


@pytest.mark.parametrize("alarms", [1.0, 30.0], ids=["lost", "sooner"])
def test_the_evidence_of_a_wing_crosses_when_the_axis_alarms(alarms: float) -> None:
    traces, raised = traced(Wired(left=0.4).tlog(), false_alarms=alarms)
    time_s, alarm, evidence = traces["roll", "evidence"].T
    (first, *_) = [event.time_s for event in raised if event.actuator == "roll"]
    assert time_s[evidence >= alarm][0] == first
    _, asked, flown = traces["roll", "response"].T
    late = traces["roll", "response"][:, 0] > first + 5.0
    assert np.polyfit(asked[~late], flown[~late], 1)[0] == pytest.approx(1.0, abs=0.15)
    assert np.polyfit(asked[late], flown[late], 1)[0] == pytest.approx(0.4, abs=0.15)


def test_the_evidence_of_sound_vehicles_stays_below_an_alarm() -> None:
    for content in (Wired().tlog(), encoded(driven(None)), hovered(0.0)):
        traces, raised = traced(content)
        assert not raised
        assert traces
        for (_, kind), rows in traces.items():
            assert (np.diff(rows[:, 0]) > 0).all()
            assert kind != "evidence" or (rows[:, 2] < rows[:, 1]).all()


def test_the_evidence_of_a_rover_crosses_when_its_steering_alarms() -> None:
    traces, raised = traced(encoded(driven(SteeringFault(200.0, 0.5))))
    time_s, alarm, evidence = traces["steering", "evidence"].T
    assert time_s[evidence >= alarm][0] == raised[0].time_s


def test_the_evidence_crosses_of_the_motor_that_fails_and_of_no_other() -> None:
    traces, raised = traced(hovered(0.5))
    for motor in range(1, 5):
        name = f"motor {motor}"
        time_s, alarm, evidence = traces[name, "evidence"].T
        crossed = time_s[evidence >= alarm]
        assert bool(crossed.size) == (name == raised[0].actuator)
        if crossed.size:
            assert crossed[0] == pytest.approx(raised[0].time_s, abs=0.5)
        assert traces[name, "thrust"][:, 2].max() <= 1.0
    assert {("frame", "roll_angle"), ("frame", "pitch_angle")} <= traces.keys()


def test_nothing_is_traced_unless_it_is_drawn() -> None:
    _, events = judged(Wired(left=0.4).tlog())
    assert not any(isinstance(event, Trace) for event in events)
