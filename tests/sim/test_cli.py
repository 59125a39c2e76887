"""``mavhums-sim``: what it writes, what it says, how it exits."""

from __future__ import annotations

import json
import os
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.validation import Check
from tests.conftest import Run


def truth_of(log: Path) -> dict[str, Any]:
    """The truth beside a log of one flight."""
    [flight] = json.loads(log.with_suffix(".truth.json").read_text())["flights"]
    return dict(flight)


def test_flight_writes_a_log_and_its_truth(tmp_path: Path, simulate: Run) -> None:
    log = tmp_path / "flight.tlog"
    options = "--friction elevator=0.225..1.0 --friction rudder=0.9 --duration 2 --seed 7"
    outcome = simulate("flight", "-o", log, *options.split())
    assert outcome.code == 0
    truth = truth_of(log)
    assert truth["seed"] == 7
    assert truth["actuators"]["elevator"]["friction_nm"] == {"start": 0.225, "end": 1.0}
    assert truth["actuators"]["rudder"]["friction_nm"] == {"start": 0.9, "end": 0.9}
    assert f"{sum(truth['messages'].values()):,} messages" in outcome.out
    before = log.read_bytes()
    outcome = simulate("flight", "-o", log, "--duration", "1")
    assert outcome.code == 2
    assert "is there already; name another, or replace it with --force" in outcome.err
    assert log.read_bytes() == before
    assert simulate("flight", "-o", log, "--duration", "1", "--force").code == 0
    assert log.read_bytes() != before


def test_a_flight_into_a_device_leaves_the_device(tmp_path: Path) -> None:
    link = tmp_path / "link.tlog"
    link.symlink_to(tmp_path / "real.tlog")
    write_tlog(fly(Flight(seed=1, duration_s=1.0)), Path(os.devnull))
    assert not Path(os.devnull).is_file()
    write_tlog(fly(Flight(seed=1, duration_s=1.0)), link)
    assert link.is_symlink()
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["link.tlog", "real.tlog"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["flight"], "Missing option '-o'"),
        (["flight", "-o", "x.tlog", "--friction", "elevator"], "not SURFACE=N·m"),
        (["flight", "-o", "x.tlog", "--friction", "flap=0.2"], "no surface 'flap'"),
        (["flight", "-o", "x.tlog", "--friction", "rudder=-0.2"], "zero or more"),
        (["flight", "-o", "x.tlog", "--friction", "rudder=nan"], "zero or more"),
        (["flight", "-o", "x.tlog", "--duration", "0"], "--duration"),
        (["flight", "-o", "x.tlog", "--duration", "0.5"], "duration"),
        (["flight", "-o", "x.tlog", "--rate", "501"], "rate"),
        (["campaign", "lunar", "-o", "x"], "no campaign 'lunar'; there is paper"),
        (["land"], "No such command"),
        (["flight", "-o", "x.tlog", "--fault", "rudder=jam"], "not SURFACE=FAULT:SEVERITY"),
        (["flight", "-o", "x.tlog", "--fault", "rudder=jam:much"], "could not convert"),
        (["flight", "-o", "x.tlog", "--friction-method", "coulomb"], "karnopp"),
        (["flight", "-o", "x.tlog", "--channel", "rudder=17"], "output 1…16"),
        (["flight", "-o", "x.tlog", "--key", "abc"], "hexadecimal"),
        (["flight", "-o", "x.tlog", "--loss", "1"], "loss and late"),
        (["stream", "14550", "--duration", "1"], "not udpout:HOST:PORT"),
        (["stream", "udpout:127.0.0.1:14550", "--speed", "0"], "--speed"),
        (["campaign", "moon.toml", "-o", "x", "--seed", "1"], "set in moon.toml"),
        (["campaign", "moon.toml.txt", "-o", "x"], "or a FILE.toml"),
    ],
)
def test_wrong_usage_is_explained_and_exits_2(
    arguments: list[str], says: str, monkeypatch: pytest.MonkeyPatch, simulate: Run, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = simulate(*arguments)
    assert outcome.code == 2
    assert says in outcome.err
    assert not list(tmp_path.iterdir())


def test_unwritable_file_is_one_line_and_exits_1(tmp_path: Path, simulate: Run) -> None:
    missing = tmp_path / "nowhere" / "flight.tlog"
    outcome = simulate("flight", "-o", missing, "--duration", "1")
    assert outcome.code == 1
    assert outcome.err.startswith("mavhums-sim: ")
    assert outcome.err.count("\n") == 1


def test_friction_is_integrated_as_the_paper_says(tmp_path: Path, simulate: Run) -> None:
    """Karnopp's method counts slow motion as rest, so the two flights differ, and little."""
    truths = []
    for method in ("impulse", "karnopp"):
        log = tmp_path / f"{method}.tlog"
        asked = ("--duration", "5", "--friction-method", method, "--fault", "rudder=jam:10@1..2")
        assert simulate("flight", "-o", log, *asked).code == 0
        truths.append(truth_of(log)["actuators"])
    moved = [truth["elevator"]["moving_fraction"] for truth in truths]
    assert moved[0] != moved[1]
    assert moved[0] == pytest.approx(moved[1], abs=0.05)
    assert truths[0]["rudder"]["conditions"][0]["until_s"] == 2.0


def test_flight_takes_faults_individuals_and_a_link(tmp_path: Path, simulate: Run) -> None:
    log = tmp_path / "flight.tlog"
    options = "--duration 2 --fault rudder=jam:10@1 --fault rudder=backlash:0..0.3 --model two-mass"
    options += " --mavlink 1 --aircraft 3 --cyclogram gusts --esc-side bus --loss 0.2"
    assert simulate("flight", "-o", log, *options.split()).code == 0
    truth = truth_of(log)
    rudder = truth["actuators"]["rudder"]
    faults = [("jam", 10.0, 10.0, 1.0), ("backlash", 0.0, 0.3, 0.0)]
    assert [(c["fault"], c["start"], c["end"], c["at_s"]) for c in rudder["conditions"]] == faults
    assert (truth["cyclogram"], truth["model"], truth["esc_side"]) == ("gusts", "two-mass", "bus")
    assert rudder["individual"]["viscous"] > 0
    assert "DEBUG_FLOAT_ARRAY" not in truth["messages"]
    assert truth["messages"]["SERVO_OUTPUT_RAW"] < 95


def test_flight_reports_in_the_tiers_asked_for(tmp_path: Path, simulate: Run) -> None:
    log = tmp_path / "flight.tlog"
    tiers = ["--tier", "esc-signed", "--tier", "named", "--reboot", "0.5", "--clock-drift", "50"]
    assert simulate("flight", "-o", log, "--duration", "4", *tiers).code == 0
    truth = truth_of(log)
    assert {"ESC_STATUS", "NAMED_VALUE_FLOAT"} <= set(truth["messages"])
    assert not {"DEBUG_FLOAT_ARRAY", "SERVO_OUTPUT_RAW"} & set(truth["messages"])
    assert truth["tiers"] == ["esc-signed", "named"]


def test_flight_replays_a_log_as_long_as_it_lasts(tmp_path: Path, simulate: Run) -> None:
    first, second = tmp_path / "first.tlog", tmp_path / "second.tlog"
    assert simulate("flight", "-o", first, "--duration", "4").code == 0
    outcome = simulate("flight", "-o", second, "--replay", first, "--hold")
    assert outcome.code == 0
    truth = truth_of(second)
    assert truth["cyclogram"] == "replay of first.tlog"
    assert truth["duration_s"] == pytest.approx(4.0, abs=0.1)
    assert "elevator from output 3" in outcome.err
    again = ("flight", "-o", second, "--force", "--replay")
    outcome = simulate(*again, first, *["--channel", "rudder=4", "--duration", "2"])
    assert outcome.code == 0
    assert "replaying rudder from output 4" in outcome.err
    assert simulate(*again, tmp_path / "none.tlog").code == 1


def test_stream_sends_the_flight(simulate: Run) -> None:
    outcome = simulate("stream", "udpout:127.0.0.1:9", "--duration", "1", "--speed", "100")
    assert outcome.code == 0
    assert "DEBUG_FLOAT_ARRAY 400" in outcome.out
    assert "HEARTBEAT 1" in outcome.out


def test_link_that_nobody_answers_is_one_line(simulate: Run) -> None:
    outcome = simulate("stream", "tcp:127.0.0.1:9", "--duration", "1")
    assert outcome.code == 1
    assert "mavhums-sim: " in outcome.err


def test_campaign_from_a_file(tmp_path: Path, simulate: Run) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text("duration_s = 1\nconditions = [{fault = 'friction', severity = [0.1, 0.2]}]\n")
    assert simulate("campaign", plan, "-o", tmp_path / "logs").code == 0
    assert len(json.loads((tmp_path / "logs" / "truth.json").read_text())["flights"]) == 2
    plan.write_text("conditions = 1")
    assert simulate("campaign", plan, "-o", tmp_path / "logs").code == 2
    assert simulate("campaign", tmp_path / "no.toml", "-o", tmp_path / "logs").code == 1


@pytest.mark.parametrize(("measured", "code", "says"), [(1.0, 0, "1 of 1"), (2.0, 1, "FAILED")])
def test_validate_reports_and_exits(
    measured: float, code: int, says: str, monkeypatch: pytest.MonkeyPatch, simulate: Run
) -> None:
    check = Check("speed", 1.0, measured, "rad/s", 0.1)
    monkeypatch.setattr("mavhums_sim.validation.validate", lambda: iter([check]))
    outcome = simulate("validate")
    assert outcome.code == code
    assert says in outcome.out


def test_interrupt_exits_130(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulate: Run) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mavhums_sim.campaign.run_campaign", interrupted)
    outcome = simulate("campaign", "paper", "-o", tmp_path, "--duration", "1")
    assert outcome.code == 130
    assert "stopped" in outcome.err


def test_a_campaign_writes_its_folder_and_a_progress_bar_on_a_terminal_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulate: Run
) -> None:
    arguments = ("campaign", "paper", "-o", tmp_path, "--duration", "1")
    outcome = simulate(*arguments)
    assert (outcome.code, outcome.err) == (0, "")
    assert "9 flights of 1 s" in outcome.out
    assert len(list(tmp_path.glob("*.tlog"))) == 9
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    outcome = simulate(*arguments)
    assert outcome.code == 0
    assert "flying" in outcome.err


def test_module_runs_as_a_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["mavhums_sim", "--help"])
    runpy.run_module("mavhums_sim", run_name="__main__")
    assert "mavhums-sim flight" in capsys.readouterr().out
