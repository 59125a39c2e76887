"""From logs to learning, unchanged and changed: a servo of which nothing but its telemetry is known."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import pytest

import mavhums
from mavhums.results.assessment import Assessment
from mavhums_sim import Flight, Gearbox, fly
from mavhums_sim.conditions import Condition
from mavhums_sim.dataflash import write_dataflash
from mavhums_sim.ema import EmaParameters
from mavhums_sim.link import Link
from mavhums_sim.telemetry import write_tlog
from tests.conftest import Run

PROFILE = """\
name = "blank"
[[actuators]]
name = "elevator"
servo = 3
esc = 2
pwm_us = [1000, 1500, 2000]
"""
PARAMETERS = EmaParameters.from_data_sheet(gearbox=Gearbox())
BEGIN = datetime(2025, 3, 1, tzinfo=UTC)


def log_of(folder: Path, number: int, added_nm: float = 0.0) -> Path:
    worn = {"elevator": (Condition.constant("friction", added_nm),)} if added_nm else {}
    flight = Flight(
        seed=8800 + number,
        duration_s=60.0,
        rate_hz=50.0,
        parameters=PARAMETERS,
        individuals=12,
        cyclogram=("takeoff", "gusts")[number % 2],
        conditions=worn,
        tiers=("esc-signed", "pwm"),
    )
    path = folder / f"{number}.tlog"
    write_tlog(fly(flight), path, Link(day=float(number)))
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten flights kept in a store, flown on the days before."""
    folder = tmp_path_factory.mktemp("own")
    profile = folder / "blank.toml"
    profile.write_text(PROFILE, encoding="utf-8")
    (folder / "logs").mkdir()
    for number in range(10):
        path = log_of(folder / "logs", number)
        mavhums.analyse(path, airframe=profile, store=folder / "flights", aircraft="=D-A", keep=True)
    return folder


def condition(assessment: Assessment) -> str:
    return next(v.condition for v in assessment.verdicts if v.subject == "actuator")


@pytest.mark.slow
def test_ten_flights_are_learnt_and_the_eleventh_is_judged(run: Run, flown: Path) -> None:
    first = mavhums.analyse(flown / "logs" / "0.tlog", mavhums.Options(airframe=flown / "blank.toml"))
    assert condition(first) == "learning"
    assert Assessment.model_validate_json(first.to_json()).to_json() == first.to_json()
    healthy = log_of(flown / "logs", 20)
    given = ("--airframe", flown / "blank.toml", "--store", flown / "flights", "--aircraft", "=D-A")
    outcome = run("analyse", healthy, *given)
    words = " ".join(outcome.out.split())
    assert "elevator: unchanged" in words
    assert re.search(r"a rise of \d+% would have been found", words)
    worn = run("analyse", log_of(flown / "logs", 21, 0.2), *given)
    assert worn.code == 10
    assert "elevator: changed" in " ".join(worn.out.split())
    assert "inspect gearbox, bearings and hinge line" in " ".join(worn.out.split())


@pytest.mark.slow
def test_a_recording_shows_what_only_the_comparison_found(flown: Path) -> None:
    options = mavhums.Options(airframe=flown / "blank.toml", store=flown / "flights", aircraft="=D-A")
    path = flown / "worn.rrd"
    assessment = mavhums.analyse(log_of(flown / "logs", 31, 0.2), options, recording=path)
    assert condition(assessment) == "changed"
    assert b"changed" in path.read_bytes()


@pytest.mark.parametrize("bus", ["supply", "autopilot"])
def test_at_a_bus_the_angle_is_compared_and_without_one_nothing(bus: str, run: Run, tmp_path: Path) -> None:
    profile, path = tmp_path / "bus.toml", tmp_path / ("bus.tlog" if bus == "supply" else "bus.BIN")
    esc = "esc = 2\n" if bus == "supply" else ""
    profile.write_text(PROFILE.replace("esc = 2\n", f'{esc}esc_side = "bus"\n'), encoding="utf-8")
    tier = "esc-signed" if bus == "supply" else "csrv"
    flight = Flight(8850, 60.0, rate_hz=50.0, parameters=PARAMETERS, esc_side="bus", tiers=(tier, "pwm"))
    (write_tlog if bus == "supply" else write_dataflash)(fly(flight), path)
    assessment = mavhums.analyse(path, mavhums.Options(airframe=profile))
    [verdict] = [verdict for verdict in assessment.verdicts if verdict.subject == "actuator"]
    if bus == "autopilot":
        assert verdict.condition == "learning"
        assert [indicator.fault for indicator in verdict.indicators] == ["tracking"]
    else:
        assert verdict.condition == "undecided"
        assert verdict.reason_codes == ("bus_power",)
    assert run("analyse", path, "--airframe", profile).code == 12
