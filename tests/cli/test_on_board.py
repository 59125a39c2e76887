"""Every command on the log that the autopilot keeps, as on a telemetry log."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mavhums_sim import Flight, fly, write_dataflash
from tests.conftest import REAL_LOGS, Run, needs

F25 = REAL_LOGS / "sitl" / "control" / "f25_jam_bin.BIN.gz"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("on_board") / "flight.BIN"
    flight = Flight(seed=4, duration_s=20.0, rate_hz=50.0, friction_nm={"elevator": (1.1, 1.1)},
                    tiers=("csrv", "pwm"))  # fmt: skip
    write_dataflash(fly(flight), path)
    return path


def test_inspect_says_what_it_holds(run: Run, log: Path) -> None:
    content = json.loads(run("inspect", log, "--json").out)
    assert content["assessment"]["log"]["start_utc"].startswith("2026-01-01T09:00:00")
    [vehicle] = content["vehicles"]
    assert (vehicle["vehicle"], vehicle["airframe"], vehicle["tier"]) == (1, "paper", "csrv")
    elevator = next(a for a in content["assessment"]["verdicts"] if a["actuator"] == "elevator")
    assert elevator["provenance"]["V3"] == "CSRV[2].Pos"
    rates = {message["name"]: message["rate_hz"] for message in content["messages"]}
    assert rates["CSRV"] == pytest.approx(200, abs=5)


def test_analyse_judges_it(run: Run, log: Path, tmp_path: Path) -> None:
    recording = tmp_path / "flight.rrd"
    outcome = run("analyse", log, "--json", "--rrd", recording)
    assert outcome.code == 11
    content = json.loads(outcome.out)
    assert content["log"]["format"] == "dataflash"
    assert content["log"]["flight"][0]["board"] == "4D415648554D5353494D0001"
    conditions = {verdict["actuator"]: verdict["condition"] for verdict in content["verdicts"]}
    assert conditions["elevator"] == "emergency"
    assert recording.stat().st_size > 10_000


@pytest.mark.slow
@needs(F25)
def test_a_jam_is_seen_through_csrv(run: Run, tmp_path: Path) -> None:
    import gzip

    path, profile = tmp_path / "f25.BIN", tmp_path / "f25.toml"
    path.write_bytes(gzip.decompress(F25.read_bytes()))
    profile.write_text(run("profile", "new", path).out)
    outcome = run("analyse", path, "--airframe", profile, "--json")
    assert outcome.code == 11
    verdicts = [v for v in json.loads(outcome.out)["verdicts"] if v.get("subject", "actuator") == "actuator"]
    worst = {verdict["actuator"]: verdict["worst"] for verdict in verdicts}
    assert worst.pop("aileron_1") == "emergency"
    assert "emergency" not in worst.values()
    jam = next(v for v in verdicts if v["actuator"] == "aileron_1")
    assert {e["kind"] for e in jam["evidence"]} == {"jam"}
    start, end = jam["evidence"][0]["start_s"], jam["evidence"][0]["end_s"]
    fault_s, clear_s = 237.66 - 26.33, 437.05 - 26.33  # of boot, and the log begins 26.33 s after it
    assert fault_s - 5 <= start <= fault_s + 15
    assert clear_s - 15 <= end <= clear_s + 15
