"""The benchmarks' flights: each has the labels of what was flown."""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from mavhums_sim.closed_loop import SurfaceFault


@pytest.fixture(scope="module")
def flights() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[3] / "benchmarks"))
        yield importlib.import_module("_closed_loop")


def test_campaigns_cover_what_they_say(flights: ModuleType) -> None:
    jams = list(flights.jams())
    assert {planned.rate for planned in jams} == set(flights.RATES)
    assert {planned.flight.air.turbulence for planned in jams} == set(flights.TURBULENCE)
    assert {planned.flight.mission for planned in jams} == {"waypoints", "loiter", "heading", "manual"}
    left = {round(fault.value, 3) for planned in flights.losses() for fault in planned.flight.faults}
    assert left == {0.0, 0.2, 0.4, 0.6, 0.8}
    met = {confounder.kind for planned in flights.confounders() for confounder in planned.flight.confounders}
    assert met == {"engine", "airspeed", "wind", "gps"}
    assert sum(planned.flight.duration_s for planned in flights.healthy(5.0)) == pytest.approx(5.0 * 3600.0)
    assert len({planned.name for planned in jams}) == len(jams)
    assert list(flights.healthy(1.0, seed=1)) != list(flights.healthy(1.0, seed=2))


@pytest.mark.slow
def test_labels_say_what_was_flown(flights: ModuleType, tmp_path: Path) -> None:
    whole = next(iter(flights.losses()))
    both = tuple(SurfaceFault(name, "gain", 0.5, 26.0, 29.0) for name in ("aileron_left", "aileron_right"))
    failing = replace(whole, name="weak", flight=replace(whole.flight, duration_s=32.0, faults=both))
    healthy = replace(whole, name="well", flight=replace(whole.flight, duration_s=30.0, faults=()))
    path = flights.write([failing, healthy], tmp_path)
    with path.open(newline="") as file:
        weak, well = csv.DictReader(file)
    assert (weak["file"], weak["kind"], weak["surface"]) == ("weak.tlog", "gain", "aileron")
    assert (weak["t_fault_boot_s"], weak["t_clear_boot_s"]) == ("56.00", "59.00")
    assert weak["servos"] == "aileron_left(SERVO1)+aileron_right(SERVO2)"
    assert set(json.loads(weak["demand_at_fault"].replace(";", ","))) == {"1", "2"}
    assert (well["kind"], well["surface"], well["t_fault_boot_s"]) == ("none", "none", "")
    assert (tmp_path / "weak.tlog").stat().st_size > 10_000
