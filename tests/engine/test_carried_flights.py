"""Whole flights that travel with the tests: which axis is lost, since when, and that nothing else is."""

from __future__ import annotations

import json

import pytest

import mavhums
from tests.conftest import CARRIED
from tests.present import present

LOST = {
    "healthy.tlog": {},
    "aileron_frozen.tlog": {"roll": 90.0},
    "elevator_frozen.tlog": {"pitch": 120.0},
    "elevon_frozen.tlog": {"roll": 110.0, "pitch": 110.0},
    "px4_aileron_frozen.tlog": {"roll": 90.0},
    "engine_out.tlog": {},
}
LONGEST_S = 60.0  # from a fault to its alarm


def test_every_carried_flight_is_judged() -> None:
    flown = {path.name for path in CARRIED.iterdir() if path.suffix in (".tlog", ".BIN")}
    assert flown == {*LOST, "friction.BIN"}
    for name in flown:
        assert json.loads((CARRIED / name).with_suffix(".truth.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "lost"), LOST.items(), ids=LOST)
def test_the_lost_axis_is_found_and_no_other(name: str, lost: dict[str, float]) -> None:
    assessment = mavhums.analyse(CARRIED / name)
    alarms = {
        verdict.actuator: min(one.start_s for one in verdict.evidence if not one.rule.startswith("normal"))
        for verdict in assessment.verdicts
        if verdict.worst in ("degraded", "emergency")
    }
    assert alarms.keys() == lost.keys()
    for axis, fault_s in lost.items():
        assert fault_s <= alarms[axis] <= fault_s + LONGEST_S
    assert all(v.condition == "unmonitored" for v in assessment.verdicts if v.subject == "actuator")


def test_an_on_board_log_separates_the_worn_servo_from_the_sound_ones() -> None:
    assessment = mavhums.analyse(CARRIED / "friction.BIN")
    found = {v.actuator: v for v in assessment.verdicts if v.subject == "actuator"}
    assert {name: verdict.condition for name, verdict in found.items()} == {
        "elevator": "emergency",
        "aileron_left": "normal",
        "aileron_right": "normal",
        "rudder": "normal",
    }
    friction = present(found["elevator"].friction_nm)
    assert friction.low < 1.0 < friction.high
