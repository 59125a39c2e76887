"""A propeller that loses a piece between two flights, through the command line and the store."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mavhums_sim.multirotor.craft import draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates, write_dataflash
from tests.conftest import Run

CRAFT = draw_craft(np.random.default_rng(5), "quad x")
RADII = np.array([6.0, 8.0, 5.0, 9.0])


def log(folder: Path, day: int, rates: Rates, times: float = 1.0) -> Path:
    flown = fly(CRAFT, draw_plan(np.random.default_rng([day, 2]), 90.0), day)
    path = folder / f"{day}.BIN"
    radii = RADII * np.where(np.arange(4) == 2, times, 1.0)
    write_dataflash(flown, path, rates, day, unbalance_um=radii, day=float(day))
    return path


def test_the_store_shows_which_propeller_changed(run: Run, tmp_path: Path) -> None:
    rates = Rates(esc=10.0, raw=500.0)
    history = ("--store", str(tmp_path / "flights"), "--aircraft", "=Q-A", "--keep")
    for day in range(3):
        run("analyse", log(tmp_path, day, rates), *history)
    healthy = json.loads(run("analyse", log(tmp_path, 3, rates), "--json", *history).out)
    motors = [one for one in healthy["verdicts"] if one["subject"] == "motor"]
    assert {one["condition"] for one in motors} == {"normal"}
    shown = [{item["fault"]: item for item in one["indicators"]}["unbalance"] for one in motors]
    assert [item["value"]["estimate"] for item in shown] == pytest.approx([*RADII], rel=0.1)
    assert [item["baseline_flights"] for item in shown] == [3] * 4
    told = run("analyse", log(tmp_path, 4, rates, 4.0), *history).out
    assert "motor 3 (front left): its rotor is out of balance" in told
    assert "its rotor shakes the aircraft" in " ".join(told.split())
    assert "inspect the propeller, its hub and the bearings of motor 3" in " ".join(told.split())
    trend = run("trend", "Q-A", "--fault", "unbalance", "--store", str(tmp_path / "flights")).out
    assert "unbalance of the rotor" in trend
    assert "motor 3: degraded since flight 5 of 5" in " ".join(trend.split())


def test_what_no_esc_reports_the_speed_of_has_no_unbalance(run: Run, tmp_path: Path) -> None:
    found = json.loads(run("analyse", log(tmp_path, 1, Rates(raw=500.0)), "--json").out)["verdicts"]
    assert all(item["fault"] != "unbalance" for one in found for item in one["indicators"])
