"""An axis that its flight cannot judge, after flights of the same aircraft that tell how it responds."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mavhums_sim.closed_loop import Air, ClosedLoop, SurfaceFault, fly_closed_loop
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.reports import Streams, report
from mavhums_sim.link import Link
from tests.conftest import Run

pytestmark = pytest.mark.slow


def log(folder: Path, day: int, rate_hz: float, *faults: SurfaceFault, seconds: float = 420.0) -> Path:
    air = Air(3.0 + day % 3, 40.0 * day, 4.0)
    flight = ClosedLoop(seed=600 + day, airframe=4, duration_s=seconds, air=air, faults=faults)
    flown = fly_closed_loop(flight)
    path = folder / f"{day}.tlog"
    path.write_bytes(encode(report(flown, Streams(rate=rate_hz, status=2.0)), day, Link(day=day)))
    return path


def pitch(run: Run, path: Path, *options: str) -> dict[str, object]:
    verdicts = json.loads(run("analyse", path, "--json", *options).out)["verdicts"]
    [found] = [verdict for verdict in verdicts if verdict["actuator"] == "pitch"]
    return dict(found)


def test_a_short_flight_at_4_hz_is_judged_by_earlier_ones_at_10_hz(run: Run, tmp_path: Path) -> None:
    history = ("--store", str(tmp_path / "flights"), "--aircraft", "=D-A")
    for day in range(6):
        assert pitch(run, log(tmp_path, day, 10.0), *history, "--keep")["condition"] == "normal"
    healthy = log(tmp_path, 10, 4.0, seconds=100.0)
    assert pitch(run, healthy)["condition"] == "undecided"
    found = pitch(run, healthy, *history)
    assert found["condition"] == "normal"
    assert "6 earlier flights" in str(found["reason"])
    weak = log(tmp_path, 11, 4.0, SurfaceFault("elevator", "gain", 0.55, 30.0), seconds=120.0)
    assert pitch(run, weak)["condition"] == "undecided"
    assert pitch(run, weak, *history)["condition"] == "emergency"
