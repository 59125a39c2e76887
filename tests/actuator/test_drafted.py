"""What needs no limit needs no profile: the log's own parameters draft one, while it is read."""

from __future__ import annotations

from pathlib import Path

import pytest

import mavhums
from mavhums.app.inspection import inspect_log
from mavhums_sim import Flight, fly
from mavhums_sim.conditions import Condition
from mavhums_sim.dataflash import write_dataflash
from tests.conftest import REAL_LOGS, Run, needs
from tests.judge import judged

NAMED = b"mavhums airframe=paper"
CSRV_LOG = REAL_LOGS / "sitl" / "plane_lua_csrv.link1.tlog"


@pytest.fixture(scope="module")
def unnamed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An on-board log with CSRV in which the elevator jams, and nothing names a profile."""
    jam = {"elevator": (Condition.step("jam", 10.0, 30.0),)}
    flight = Flight(seed=5, duration_s=60.0, rate_hz=50.0, tiers=("csrv", "pwm"), conditions=jam)
    path = tmp_path_factory.mktemp("drafted") / "flight.BIN"
    write_dataflash(fly(flight), path)
    content = path.read_bytes()
    assert NAMED in content
    path.write_bytes(content.replace(NAMED, b"an aircraft of its own"))
    return path


@pytest.mark.slow
def test_a_jam_is_found_without_a_profile(unnamed: Path) -> None:
    assessment = mavhums.analyse(unnamed)
    verdicts = {verdict.actuator: verdict for verdict in assessment.verdicts if verdict.subject == "actuator"}
    assert assessment.airframe == "drafted"
    assert verdicts["elevator"].worst == "emergency"
    assert "jam" in {suspect.fault for suspect in verdicts["elevator"].suspects}
    assert verdicts["elevator"].evidence[0].start_s == pytest.approx(30.0, abs=3.0)
    others = {verdict.worst for name, verdict in verdicts.items() if name != "elevator"}
    assert others <= {"learning", "undecided"}
    [notice] = assessment.log.notices
    assert notice.startswith("no profile was named: one is drafted")
    assert "guessed" not in notice, "CSRV names what it sends"


@pytest.mark.slow
def test_the_draft_does_not_depend_on_the_blocks(unnamed: Path) -> None:
    content = unnamed.read_bytes()
    whole = judged([content])[0].to_json()
    for size in (997, 40_003, 1 << 18):
        assert judged(content, size=size)[0].to_json() == whole


def test_inspect_says_that_it_can_be_judged(unnamed: Path) -> None:
    inspection = inspect_log(unnamed)
    assert [one.airframe for one in inspection.vehicles] == ["drafted"]
    assert {one.actuator for one in inspection.assessment.verdicts} >= {"elevator", "rudder"}


def test_a_profile_that_is_given_is_used(unnamed: Path, run: Run) -> None:
    assessment = mavhums.analyse(unnamed, mavhums.Options(airframe="paper"))
    assert assessment.airframe == "paper"
    assert not assessment.log.notices


@needs(CSRV_LOG)
def test_what_named_values_mean_stays_a_guess() -> None:
    """A script forwards servo feedback as S1Pos and the like; an aileron's servo jams in the air."""
    assessment = mavhums.analyse(CSRV_LOG)
    verdicts = {verdict.actuator: verdict for verdict in assessment.verdicts}
    assert verdicts["aileron_1"].worst == "emergency"
    assert {verdicts[name].worst for name in ("aileron_9", "elevator_2", "rudder_4")} == {"undecided"}
    assert any("mean is guessed from these names" in notice for notice in assessment.log.notices)
