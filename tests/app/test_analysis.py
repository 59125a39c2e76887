"""Judging a file: the whole log, its hash, its progress, and its recording made later."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

import mavhums
from mavhums.actuator.mapping import Samples
from mavhums.app.analysis import judge
from mavhums.app.settings import Settings
from mavhums.app.sinks import Events, Recording, Report, Sink
from mavhums.core.errors import MavhumsError
from mavhums.engine.events import Event
from mavhums.health.decision.events import ConditionChanged
from mavhums.learn import default_model
from mavhums_sim import Flight, fly, write_tlog
from tests.judge import judged


def test_the_assessment_names_its_log(growing_log: Path) -> None:
    assessment = mavhums.analyse(growing_log)
    content = growing_log.read_bytes()
    assert assessment.log.path == str(growing_log)
    assert assessment.log.sha256 == hashlib.sha256(content).hexdigest()
    assert assessment.log.duration_s == pytest.approx(40.0, abs=0.1)
    assert str(assessment.log.start_utc).startswith("2026-01-01T09:00:00.")


def test_events_and_progress_are_passed_on(growing_log: Path, tmp_path: Path) -> None:
    done: list[int] = []
    plain: list[Event] = []
    mavhums.analyse(growing_log, sinks=[Events(plain.extend)], progress=done.append)
    assert done[-1] == growing_log.stat().st_size
    assert done == sorted(done)
    recorded: list[Event] = []
    mavhums.analyse(growing_log, sinks=[Events(recorded.extend)], recording=tmp_path / "flight.rrd")
    samples = [sum(len(e.time_s) for e in events if isinstance(e, Samples)) for events in (plain, recorded)]
    assert samples == [16_000, 16_000]


def test_several_outputs_come_from_one_reading(growing_log: Path, tmp_path: Path) -> None:
    recording, report = tmp_path / "flight.rrd", tmp_path / "flight.html"
    both = mavhums.analyse(growing_log, recording=recording, report=report)
    assert both == mavhums.analyse(growing_log)
    assert recording.stat().st_size > 100_000
    assert "elevator" in report.read_text()


def test_an_output_that_fails_leaves_no_other(growing_log: Path, tmp_path: Path) -> None:
    def fail(events: object) -> None:
        raise ZeroDivisionError("nought")

    sinks: list[Sink] = [Recording(tmp_path / "flight.rrd"), Report(tmp_path / "flight.html"), Events(fail)]
    failed = judge(growing_log, Settings.read(None), sinks)
    assert failed.assessment is None
    assert "ZeroDivisionError: nought" in failed.error.problem
    assert not [*tmp_path.iterdir()]
    with pytest.raises(ZeroDivisionError):
        mavhums.analyse(growing_log, sinks=sinks)


def test_a_recording_can_be_made_later(growing_log: Path, tmp_path: Path) -> None:
    at_once, later = tmp_path / "once.rrd", tmp_path / "later.rrd"
    assessment = mavhums.analyse(growing_log, recording=at_once)
    mavhums.record(assessment, later)
    assert later.stat().st_size == pytest.approx(at_once.stat().st_size, rel=0.01)


def test_a_log_that_changed_is_not_recorded(growing_log: Path, tmp_path: Path) -> None:
    log = tmp_path / "flight.tlog"
    log.write_bytes(growing_log.read_bytes()[:500_000])
    assessment = mavhums.analyse(log)
    log.write_bytes(growing_log.read_bytes())
    with pytest.raises(MavhumsError, match="not the log that was judged"):
        mavhums.record(assessment, tmp_path / "flight.rrd")
    assert not (tmp_path / "flight.rrd").exists()


def test_the_packaged_model_is_the_papers_actuators() -> None:
    model = default_model()
    assert model.card.airframe == "paper"
    assert model.card.tier == "instrumented"
    # On flights of all six modes that nothing was trained or chosen on; in gusts the inertial torque, which
    # is in none of V1-V12, keeps single samples from the 99 % of the take-off alone.
    assert model.card.metrics["windows_right"] >= 0.995
    assert model.card.metrics["samples_in_motion_right"] > 0.97
    assert "V1" not in model.network.keys
    assert model.card.command.startswith("mavhums train --airframe paper")


@pytest.mark.slow
def test_fewer_false_alarms_are_bought_with_a_later_verdict(tmp_path: Path) -> None:
    """The same growing friction: the alarm comes later where alarms may be false less often."""
    log = tmp_path / "growing.tlog"
    write_tlog(fly(Flight(seed=3, duration_s=60.0, friction_nm={"elevator": (0.225, 0.7)})), log)
    alarms_s = []
    for false_alarms in (0.001, 1.0, 100.0):
        _, events = judged(log.read_bytes(), false_alarms=false_alarms)
        changes = [one for one in events if isinstance(one, ConditionChanged) and one.actuator == "elevator"]
        alarms_s.append(next(one.time_s for one in changes if one.after in ("degraded", "emergency")))
    assert alarms_s[0] > alarms_s[1] > alarms_s[2]
