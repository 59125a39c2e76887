"""The axes of the real logs and of ArduPlane in software-in-the-loop, from ordinary messages alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mavhums
from mavhums.health.decision.events import Indication
from mavhums.log import read_blocks
from mavhums.results.verdict import Verdict
from tests.conftest import REAL_LOGS
from tests.judge import judged
from tests.present import present

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (REAL_LOGS / "sitl").is_dir(), reason="the real logs are absent"),
]

UNJUDGED = {
    "APTRG-wsk-gcs__mav-631b075.tlog": "too_slow",
    "EAICS__flight.tlog": "never_armed",
    "EAICS__flight.tlog.raw": "never_armed",
    "TalhaYS-savasan_iha__mav.tlog": "never_armed",
    "ardusub_log_tools__pymavlink_bug.tlog": "no_wings",
    "autonomous-soaring__00000001.BIN": "never_armed",
    "mavlink-server__00025-2024-04-22_18-49-07.tlog": "no_wings",
    "mavrik-control__mav.tlog": "stopped",
    "pydronecan__mav.tlog": "never_armed",
    "onboard/mavrik464.BIN": "too_slow",
    "onboard/mavrik470.BIN": "too_slow",
    "onboard/sample_log_small.ulg": "too_slow",
}
COPTERS = {
    "AalborgQSL-Firmware__mav.tlog": "undecided",
    "Avalanche-MQP-ros__mav.tlog": "undecided",
    "Fugaintegrum__2019-08-08-flight1.tlog": "undecided",
    "LucaGemma-MasterThesis__mav.tlog": "undecided",
    "PX4-flight-review-rs__ekf_failure.ulg": "undecided",
    "ahmadkhanfar-TLOG__test.tlog": "normal",
    "onboard/beast_sample.bin": "undecided",
    "onboard/dani1.BIN": "undecided",
    "onboard/gps_interference.ulg": "normal",
    "onboard/hexa_real.bin": "emergency",  # software in the loop: motor 1 stops first
    "onboard/lrs17.BIN": "undecided",
    "onboard/sample.ulg": "undecided",
    "onboard/sample_appended_multiple.ulg": "undecided",
}
"""Multirotors, by the condition of their motors."""

HEALTHY = {
    "Jordinaa-supervisor__mav.tlog": {},
    "UAVLogViewer__vtol.tlog": {},  # a tiltrotor that flies forward for a minute
    "sitl/plane_hirate.link1.tlog": {"roll": "normal", "pitch": "normal"},
    "sitl/plane_normal.mavproxy.tlog": {"roll": "normal", "pitch": "normal"},
    "sitl/plane_signed.link1.tlog": {},
}
NO_VEHICLE = {"Fugaintegrum__2020-02-05-flight3.tlog"}
UNREADABLE = {"onboard/log171.bin"}
JAMMED = "sitl/plane_lua_csrv.link1.tlog"


def axes(path: Path) -> list[Verdict]:
    return [verdict for verdict in mavhums.analyse(path).verdicts if verdict.subject == "axis"]


def test_no_log_is_forgotten() -> None:
    known = {*UNJUDGED, *COPTERS, *HEALTHY, *NO_VEHICLE, *UNREADABLE, JAMMED}
    found = {
        str(path.relative_to(REAL_LOGS))
        for folder in (REAL_LOGS, REAL_LOGS / "sitl", REAL_LOGS / "onboard")
        for path in folder.iterdir()
        if path.is_file() and path.suffix != ".md"
    }
    assert found == known


@pytest.mark.parametrize(
    ("path", "code"), [(REAL_LOGS / name, code) for name, code in UNJUDGED.items()], ids=[*UNJUDGED]
)
def test_what_no_fixed_wing_flew_has_its_reason_in_one_line(path: Path, code: str) -> None:
    [verdict] = axes(path)
    assert (verdict.actuator, verdict.condition, verdict.worst) == ("axes", "undecided", "undecided")
    assert verdict.reason_codes == (code,)


@pytest.mark.parametrize(
    ("path", "condition"), [(REAL_LOGS / name, state) for name, state in COPTERS.items()], ids=[*COPTERS]
)
def test_motors_of_multirotors_are_judged_or_the_reason_is_given(path: Path, condition: str) -> None:
    verdicts = mavhums.analyse(path).verdicts
    assert {verdict.subject for verdict in verdicts} == {"motor"}
    assert {verdict.condition for verdict in verdicts} == {condition}
    assert all(verdict.reason and verdict.remedy for verdict in verdicts if condition == "undecided")


@pytest.mark.parametrize(
    ("path", "conditions"), [(REAL_LOGS / name, states) for name, states in HEALTHY.items()], ids=[*HEALTHY]
)
def test_healthy_flights_raise_no_alarm(path: Path, conditions: dict[str, str]) -> None:
    verdicts = {verdict.actuator: verdict for verdict in axes(path)}
    assert all(verdict.worst in ("normal", "undecided") for verdict in verdicts.values())
    assert {name: verdicts[name].condition for name in conditions} == conditions
    assert all(verdict.reason for verdict in verdicts.values() if verdict.condition == "undecided")


def test_half_the_aileron_is_left_in_the_seconds_of_the_jam() -> None:
    """One aileron of two is stuck from second 90 to 127; the windows are ten seconds long."""
    assessment, events = judged(read_blocks(REAL_LOGS / JAMMED))
    shown = [
        e for e in events if isinstance(e, Indication) and (e.actuator, e.fault) == ("roll", "effectiveness")
    ]
    end_s = np.concatenate([np.asarray(e.end_s) for e in shown])
    value = np.concatenate([np.asarray(e.value) for e in shown])
    jammed = (end_s >= 105) & (end_s <= 130)
    assert jammed.sum() >= 20
    assert value[jammed] == pytest.approx(0.49, abs=0.04)
    assert (value[(end_s <= 92) | (end_s >= 140)] > 0.85).all()
    roll = next(v for v in assessment.verdicts if v.actuator == "roll" and v.subject == "axis")
    assert roll.worst == "emergency"
    assert 90 <= present(roll.since).flight_time_s <= 110


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("2018-09-11-17-27-13_2_both_ailerons_failure.tlog", "tracking"),
        ("2018-09-11-17-55-30_1_right_aileron_failure.tlog", "effectiveness"),
        ("2018-10-05-14-37-22_3_left_aileron_failure.tlog", "effectiveness"),
    ],
)
def test_jammed_ailerons_are_found_with_inferred_outputs(name: str, fault: str) -> None:
    roll = next(verdict for verdict in axes(REAL_LOGS / "alfa" / name) if verdict.actuator == "roll")
    assert roll.worst in ("degraded", "emergency")
    assert roll.suspects[0].fault == fault
    assert "inference" in roll.provenance["V1"]


def test_slow_servos_are_no_emergency() -> None:
    """All servos of a flight follow with 0.6 s instead of 0.14 s; the trim wanders with the oscillation."""
    log = REAL_LOGS / "sitl" / "control" / "f14_slow_all_060.tlog"
    roll = next(verdict for verdict in axes(log) if verdict.actuator == "roll")
    assert (roll.condition, roll.worst) == ("degraded", "degraded")
    # A lag and a small loss move it alike.
    assert {suspect.fault for suspect in roll.suspects} <= {"slow", "effectiveness"}
