"""``mavhums-sim flight --closed-loop``: from the command line to the log."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.conftest import Run


@pytest.mark.slow
def test_closed_loop_flight_and_its_truth(tmp_path: Path, simulate: Run) -> None:
    log = tmp_path / "jam.tlog"
    options = "--duration 30 --seed 2 --surface-fault aileron_left=freeze:8@25..28.5"
    options += " --confounder engine:0.5@27 --wind 4@200 --turbulence 7 --autopilot px4"
    options += " --stream-rate 4 --aircraft 3"
    assert simulate("flight", "--closed-loop", "-o", log, *options.split()).code == 0
    truth = json.loads(log.with_suffix(".truth.json").read_text())["flights"][0]
    (fault,) = truth["faults"]
    assert (fault["surface"], fault["kind"], fault["value"]) == ("aileron_left", "freeze", 8.0)
    assert (fault["begin_boot_s"], fault["end_boot_s"]) == (55.0, 58.5)
    assert truth["confounders"][0]["kind"] == "engine"
    assert truth["wind"] == {"speed": 4.0, "from_deg": 200.0}
    assert truth["messages"]["ATTITUDE_TARGET"] == pytest.approx(4 * 30, abs=2)


@pytest.mark.slow
def test_a_fault_of_an_ema_brings_the_emas_and_their_telemetry(tmp_path: Path, simulate: Run) -> None:
    log = tmp_path / "worn.tlog"
    options = ["--fault", "elevator=friction:0.5@20", "--rate", "10"]
    assert simulate("flight", "--closed-loop", "-o", log, "--duration", "25", *options).code == 0
    truth = json.loads(log.with_suffix(".truth.json").read_text())["flights"][0]
    assert truth["emas"]["actuators"]["elevator"]["fault"] == "friction"
    assert truth["messages"]["DEBUG_FLOAT_ARRAY"] in (4 * 249, 4 * 250)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--wind", "5"], "--wind needs --closed-loop"),
        (["--closed-loop", "--cyclogram", "cruise"], "--cyclogram and --closed-loop exclude each other"),
        (["--closed-loop", "--surface-fault", "rudder"], "not SURFACE=KIND"),
        (["--closed-loop", "--surface-fault", "rudder=gain"], "needs a value"),
        (["--closed-loop", "--confounder", "engine"], "not KIND:X"),
        (["--closed-loop", "--confounder", "ice:1@5"], "no confounder 'ice'"),
        (["--closed-loop", "--wind", "strong"], "not M/S"),
        (["--closed-loop", "--confounder", "engine:0@9..5"], "the times in order"),
        (["--closed-loop", "--surface-fault", "rudder=melt"], "no surface fault 'melt'"),
        (["--closed-loop", "--surface-fault", "rudder=slow:-1"], "impossible"),
        (["--closed-loop", "--surface-fault", "rudder=freeze@9..5"], "begin before it ends"),
        (["--closed-loop", "--surface-fault", "flap=freeze"], "no surface 'flap'"),
        (["--closed-loop", *["--surface-fault", "rudder=freeze"] * 2], "one fault a surface"),
        (["--closed-loop", "--mission", "aerobatics"], "no mission"),
        (["--closed-loop", "--autopilot", "inav"], "no flavour"),
        (["--closed-loop", "--duration", "5"], "at least 10 s"),
        (["--closed-loop", "--ema", "--layout", "vtail"], "EMAs fly the conventional layout"),
        (["--closed-loop", "--wind", "30"], "wind of 30"),
        (["--closed-loop", "--turbulence", "99"], "turbulence of 99"),
        (["--closed-loop", "--layout", "canard"], "no layout 'canard'"),
        (["--closed-loop", "--stream-rate", "500"], "outside 0.5…50 Hz"),
    ],
)
def test_usage_errors_are_one_line(options: list[str], says: str, tmp_path: Path, simulate: Run) -> None:
    outcome = simulate("flight", "-o", tmp_path / "no.tlog", *options)
    assert outcome.code == 2
    assert says in outcome.err
    assert not list(tmp_path.iterdir())


def test_without_jsbsim_the_command_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulate: Run
) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    outcome = simulate("flight", "--closed-loop", "-o", tmp_path / "no.tlog")
    assert outcome.code == 2
    assert "mavhums[sim]" in outcome.err
