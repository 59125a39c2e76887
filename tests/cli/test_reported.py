"""A fault that a device reports, from the simulator's bytes to every answer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mavhums_sim import Flight, FlightRecord, fly, write_dataflash, write_tlog
from mavhums_sim.conditions import Condition
from tests.conftest import Run

STUCK_S = 20.0


def flown(jammed: bool, *tiers: str) -> FlightRecord:
    jam = {"elevator": (Condition.step("jam", 10.0, STUCK_S),)} if jammed else {}
    return fly(Flight(seed=8, duration_s=40.0, rate_hz=50.0, conditions=jam, tiers=(*tiers, "pwm")))


def reported(run: Run, log: Path) -> list[dict[str, Any]]:
    events = json.loads(run("analyse", log, "--json").out)["events"]
    return [event for event in events if event["kind"] in ("fault", "errors")]


def write(path: Path, *, jammed: bool) -> Path:
    if path.suffix == ".tlog":
        write_tlog(flown(jammed, "esc-signed", "esc-info"), path)
    else:
        write_dataflash(flown(jammed, "csrv", "esc-unsigned"), path)
    return path


@pytest.mark.parametrize(
    ("name", "foremost", "also"),
    [
        ("jam.tlog", "ESC 3 reports a stuck motor", "the error count of ESC 3 grows by"),
        ("jam.BIN", "servo 3 reports error flag 0x01", "ESC 3 reports an error (stall)"),
    ],
)
def test_what_a_device_reports_is_in_every_answer(
    run: Run, tmp_path: Path, name: str, foremost: str, also: str
) -> None:
    log = write(tmp_path / name, jammed=True)
    found = reported(run, log)
    assert {event["subject"].split()[1] for event in found} == {"3"}
    assert all(STUCK_S < event["time_s"] < STUCK_S + 3.0 for event in found)
    assert foremost in " ".join(run("analyse", log).out.split())
    page = tmp_path / "page.html"
    run("report", log, "-o", page)
    assert foremost in page.read_text()
    assert also in page.read_text()


@pytest.mark.parametrize("name", ["healthy.tlog", "healthy.BIN"])
def test_a_healthy_actuator_reports_nothing(run: Run, tmp_path: Path, name: str) -> None:
    assert not reported(run, write(tmp_path / name, jammed=False))
