"""The five commands of the researcher's page, word for word, on short flights with all nine classes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib import resources
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from click.testing import CliRunner

from mavhums.learn import load_model
from mavhums.learn.precedents import LABELS
from mavhums_sim.cli import cli as simulator
from mavhums_sim.cyclogram import SURFACES

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "guide" / "research.md"

FAULTS = {
    "friction_degraded": "friction:0.4",
    "friction_emergency": "friction:0.8",
    "winding_resistance": "resistance:0.5",
    "torque_constant": "torque_constant:0.25",
    "backlash": "backlash:0.5",
    "supply_sag": "supply_sag:10",
    "sensor_bias": "sensor_bias:1.5",
    "jam": "jam:10",
}


def fly(log: Path, seed: int, labels: dict[str, str]) -> None:
    given = f"flight -o {log} --duration 40 --rate 50 --model two-mass --seed {seed}".split()
    for surface, label in labels.items():
        given += ["--fault", f"{surface}={FAULTS[label]}"] if label in FAULTS else []
    outcome = CliRunner().invoke(simulator, given)
    assert outcome.exit_code == 0, outcome.output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Twelve labelled logs, each class on four actuators or more, a profile, and a new log."""
    rows = ["log,actuator,label"]
    for k in range(12):
        labels = {surface: LABELS[(4 * k + i) % len(LABELS)] for i, surface in enumerate(SURFACES)}
        fly(tmp_path / f"flight{k}.tlog", 70 + k, dict(labels))
        rows += [f"flight{k}.tlog,{surface},{label}" for surface, label in labels.items()]
    fly(tmp_path / "new.tlog", 5, {"elevator": "friction_emergency", "rudder": "backlash"})
    (tmp_path / "labels.csv").write_text("\n".join(rows))
    profile = resources.files("mavhums.actuator").joinpath("airframes/paper.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(profile.replace('name = "paper"', 'name = "mine"'), encoding="utf-8")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    return tmp_path


@pytest.mark.slow
def test_five_commands_lead_from_labelled_logs_to_figures_16_to_19(folder: Path) -> None:
    pytest.importorskip("matplotlib")
    section = PAGE.read_text(encoding="utf-8").split("## From your labelled logs")[1]
    [block, *_] = re.findall(r"```console\n(.*?)```", section, re.DOTALL)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    given: dict[str, Any] = {"cwd": folder, "env": {**os.environ, "PATH": path}, "text": True}
    commands = block.splitlines()
    assert len(commands) == 5
    for command in commands:
        done = subprocess.run(["bash", "-c", command], **given, capture_output=True, check=False)
        judged = command.startswith("mavhums analyse")
        assert done.returncode in ((0, 10, 11, 12) if judged else (0,)), done.stderr
    window = load_model(folder / "mine.model").card.window
    assert window is not None
    assert {*window.classes} == {*LABELS}
    table = pd.read_csv(folder / "new.csv")
    share = (table["class"] == "emergency").groupby(table["actuator"]).mean()
    assert share["elevator"] > 0.5
    assert share.drop("elevator").max() < 0.1
    assert "backlash" in {*pd.read_csv(folder / "new-windows.csv")["class"]}
    assert (folder / "new.rrd").read_bytes().startswith(b"RRF")
    assert (folder / "new.png").read_bytes().startswith(b"\x89PNG")
