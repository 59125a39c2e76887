"""``mavhums-sim``: what it writes, what it says, how it exits."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest

from mavhums_sim.cli import main


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """The exit code of ``mavhums-sim ARGUMENTS``."""
    monkeypatch.setattr(sys, "argv", ["mavhums-sim", *arguments])
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def test_flight_writes_a_log_and_its_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "flight.tlog"
    options = [
        "--friction",
        "elevator=0.225..1.0",
        "--friction",
        "rudder=0.9",
        "--duration",
        "2",
        "--seed",
        "7",
    ]
    assert run(monkeypatch, "flight", "-o", str(log), *options) == 0
    truth = json.loads((tmp_path / "flight.truth.json").read_text())["flights"][0]
    assert truth["seed"] == 7
    assert truth["actuators"]["elevator"]["friction_nm"] == {"start": 0.225, "end": 1.0}
    assert truth["actuators"]["rudder"]["friction_nm"] == {"start": 0.9, "end": 0.9}
    assert f"{sum(truth['messages'].values()):,} messages" in capsys.readouterr().out


def test_campaign_writes_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "campaign", "paper", "-o", str(tmp_path / "logs"), "--duration", "1") == 0
    assert len(list((tmp_path / "logs").glob("*.tlog"))) == 9
    assert "9 flights of 1 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["flight"], "Missing option '-o'"),
        (["flight", "-o", "x.tlog", "--friction", "elevator"], "not SURFACE=N·m"),
        (["flight", "-o", "x.tlog", "--friction", "flap=0.3"], "no surface 'flap'"),
        (["flight", "-o", "x.tlog", "--duration", "0"], "--duration"),
        (["campaign", "lunar", "-o", "x"], "NAME"),
        (["land"], "No such command"),
    ],
)
def test_wrong_usage_is_explained_and_exits_2(
    arguments: list[str],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *arguments) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_unwritable_file_is_one_line_and_exits_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "nowhere" / "flight.tlog"
    assert run(monkeypatch, "flight", "-o", str(missing), "--duration", "1") == 1
    error = capsys.readouterr().err
    assert error.startswith("mavhums-sim: ")
    assert error.count("\n") == 1


def test_interrupt_exits_130(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mavhums_sim.campaign.run_campaign", interrupted)
    assert run(monkeypatch, "campaign", "paper", "-o", str(tmp_path), "--duration", "1") == 130
    assert "stopped" in capsys.readouterr().err


def test_progress_bar_only_on_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("campaign", "paper", "-o", str(tmp_path), "--duration", "1")
    assert run(monkeypatch, *arguments) == 0
    assert not capsys.readouterr().err
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    assert run(monkeypatch, *arguments) == 0
    assert "flying" in capsys.readouterr().err


def test_module_runs_as_a_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["mavhums_sim", "--help"])
    runpy.run_module("mavhums_sim", run_name="__main__")
    assert "mavhums-sim flight" in capsys.readouterr().out
