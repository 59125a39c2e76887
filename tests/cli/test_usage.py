"""What was used of the servos, and what a log allows to judge, through the commands."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REAL_LOGS, Run, needs
from tests.engine.test_axes import flown

PROFILE = Path(__file__).parents[2] / "benchmarks" / "alfa.toml"
JAMMED = "alfa/2018-09-11-17-55-30_1_right_aileron_failure.tlog"

needs_logs = needs(REAL_LOGS / "alfa")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("usage") / "flight.tlog"
    path.write_bytes(flown())
    return path


def by_name(usage: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {output["name"]: output for output in usage["outputs"] if output["name"]}


def test_analyse_prints_the_use_of_every_surface(run: Run, log: Path) -> None:
    outcome = run("analyse", log, "--verbose")
    assert re.search(r"Usage: fixed wing, ArduPilot; armed 2m29s, forward flight 2m2\ds", outcome.out)
    for surface in ("elevator", "rudder"):
        assert re.search(rf"\n *{surface} +never", outcome.out)
    [usage] = json.loads(run("analyse", log, "--json").out)["usage"]
    aileron = by_name(usage)["aileron"]
    assert (aileron["servo"], aileron["named_by"], aileron["commanded"]) == (1, "parameters", True)
    assert aileron["range_us"] == [1100, 1500, 1900]
    assert aileron["span"] == pytest.approx((aileron["greatest_us"] - aileron["least_us"]) / 800, abs=1e-3)
    assert aileron["travelled"] == pytest.approx(aileron["travelled_us"] / 800, abs=1e-2)
    assert by_name(usage)["elevator"]["commanded"] is False
    assert json.loads(run("inspect", log, "--json").out)["assessment"]["usage"] == [usage]


@pytest.mark.slow
def test_inspect_says_what_can_be_judged_before_one_tries(run: Run, log: Path) -> None:
    found = json.loads(run("inspect", log, "--json").out)["assessment"]
    assert found["verdicts"] == json.loads(run("analyse", log, "--json").out)["verdicts"]
    text = " ".join(run("inspect", log).out.split())
    assert text.startswith("Roll control can be judged; pitch and yaw control and wear of aileron (servo 1)")
    assert "roll control: moved by aileron (servo 1)" in text
    assert "yaw control: undecided: " in text
    assert re.search("unmonitored: [^;]+ what to do: record each servo", text)
    assert "per second" not in text
    assert "per second" in run("inspect", log, "--messages").out


def test_inspect_says_why_nothing_can_be_judged(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "other.tlog"
    path.write_bytes(flown(20, kind=12))
    text = " ".join(run("inspect", path).out.split())
    assert text.startswith("A submarine: not judged (")
    assert "remedy" not in text


@pytest.mark.parametrize(
    ("name", "shown", "named_by", "range_us"),
    [
        ("aileron right", "aileron right", "profile", [1000, 1500, 2000]),
        ("flap right", "aileron", "parameters", [1100, 1500, 1900]),  # which contradict the profile
    ],
)
def test_the_profile_names_outputs_before_the_parameters_where_they_agree(
    run: Run, log: Path, tmp_path: Path, name: str, shown: str, named_by: str, range_us: list[int]
) -> None:
    profile = tmp_path / "own.toml"
    profile.write_text(
        f'name = "own"\n[[actuators]]\nname = "{name}"\nservo = 1\npwm_us = [1000, 1500, 2000]\n'
    )
    [usage] = json.loads(run("analyse", log, "--json", "--airframe", profile).out)["usage"]
    output = by_name(usage)[shown]
    assert (output["servo"], output["named_by"], output["range_us"]) == (1, named_by, range_us)
    assert (name in by_name(usage)) == (name == shown)


@needs_logs
def test_the_jammed_flight_of_alfa(run: Run) -> None:
    path = REAL_LOGS / JAMMED
    [usage] = json.loads(run("analyse", path, "--json", "--airframe", PROFILE).out)["usage"]
    surfaces = by_name(usage)
    assert surfaces.keys() == {"elevator", "rudder", "left aileron", "right aileron"}
    assert all(0.1 < surface["span"] < 0.4 for surface in surfaces.values())
    assert usage["forward_s"] == pytest.approx(130, abs=3)


@needs_logs
@pytest.mark.parametrize(
    ("name", "servo", "commanded"),
    [("onboard/mavrik464.BIN", 7, False), ("onboard/sample_log_small.ulg", 2, True)],
)
def test_on_board_logs_show_it_too(run: Run, name: str, servo: int, commanded: bool) -> None:
    [usage] = json.loads(run("inspect", REAL_LOGS / name, "--json").out)["assessment"]["usage"]
    [output] = [one for one in usage["outputs"] if one["servo"] == servo]
    assert output["commanded"] is commanded
