"""Every log that is judged has curves, and each place that shows them has the same."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from mavhums_sim.rover import SteeringFault, encoded
from tests.conftest import Run
from tests.engine.test_steering import driven
from tests.engine.wired import Wired
from tests.health.motor.test_monitor import log as hovered
from tests.logs import heartbeat, write_log
from tests.show.test_recording import entities, rows


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    paths = {name: folder / f"{name}.tlog" for name in ("wing", "rover")}
    paths["wing"].write_bytes(Wired(left=0.4).tlog())
    paths["rover"].write_bytes(encoded(driven(SteeringFault(200.0, 0.5))))
    return paths | {"copter": hovered(folder / "copter.tlog", "quad x", 0.5, seed=4)}


FIRST = {
    "wing": "roll control: evidence of lost or slow control",
    "rover": "steering control: evidence of lost or slow control",
    "copter": "motor 2: evidence of lost thrust",
}


@pytest.mark.parametrize("name", FIRST)
def test_report_and_table_have_the_same_curves_and_what_decided_comes_first(
    run: Run, logs: dict[str, Path], name: str, tmp_path: Path
) -> None:
    page, table = tmp_path / "report.html", tmp_path / "curves.csv"
    run("report", logs[name], "-o", page)
    assert run("export", logs[name], "--curves", "-o", table).code == 0
    titles = re.findall(r"<figure>\s*<h3>(.*?)</h3>", page.read_text(encoding="utf-8"))
    curves = pd.read_csv(table)
    assert [*dict.fromkeys(curves["curve"])] == titles
    assert titles[0] == FIRST[name]
    decided = curves[curves["curve"] == titles[0]]
    alarm = float(decided["limits"].iloc[0].removeprefix("alarm above "))
    assert decided["value"].max() > alarm > decided["value"].iloc[0]


def test_the_recording_of_a_copter_has_its_motors_and_its_frame(
    run: Run, logs: dict[str, Path], tmp_path: Path
) -> None:
    pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")
    run("analyse", logs["copter"], "--rrd", tmp_path / "flight.rrd")
    paths = entities(tmp_path / "flight.rrd")
    motors = {f"/vehicle_1/motor_{k}/{kind}" for k in range(1, 5) for kind in ("evidence", "thrust")}
    assert motors | {"/vehicle_1/frame/roll_angle", "/vehicle_1/frame/pitch_angle"} <= paths


def test_a_wing_without_a_profile_is_drawn_by_its_parameters(
    run: Run, logs: dict[str, Path], tmp_path: Path
) -> None:
    pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")
    run("analyse", logs["wing"], "--rrd", tmp_path / "flight.rrd")
    _, texts = rows(tmp_path / "flight.rrd", "/events", "TextLog:text")
    assert [said for [said] in texts if said.startswith("roll: its reference is learned from ")]
    drawn = [path for path in entities(tmp_path / "flight.rrd") if path.endswith("/part")]
    servos = {"aileron": 1, "elevator": 2, "rudder": 4}
    names = [rf"{name}\ \(servo\ {servo}\)" for name, servo in servos.items()]
    assert [path.split("/")[-2] for path in sorted(drawn)] == names


def test_a_log_without_curves_says_so(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "idle.tlog", [heartbeat(3)])
    outcome = run("export", log, "--curves", "-o", tmp_path / "curves.csv")
    assert outcome.code == 1
    assert "no curves" in outcome.err
    assert not (tmp_path / "curves.csv").exists()
