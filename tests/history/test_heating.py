"""An ESC whose cooling is blocked between two flights, through the command line and the store."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mavhums_sim.multirotor.craft import draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.heating import draw_escs, temperatures
from mavhums_sim.multirotor.log import Rates, write_dataflash, write_tlog
from tests.conftest import Outcome, Run

CRAFT = draw_craft(np.random.default_rng(5), "quad x")
ESCS = draw_escs(np.random.default_rng(5), 4)._replace(small_s=6.0, large_s=60.0)


def log(path: Path, day: int, blocked: float = 1.0) -> Path:
    flown = fly(CRAFT, draw_plan(np.random.default_rng([day, 2]), 180.0), day)
    warmth = temperatures(flown, ESCS, day, blocked=np.where(np.arange(4) == 2, blocked, 1.0))
    if path.suffix == ".BIN":
        write_dataflash(flown, path, Rates(esc=2.0), day, warmth=warmth, day=float(day))
    else:
        write_tlog(flown, path, Rates(esc=2.0), day, warmth=warmth)
    return path


def heating(done: Outcome) -> list[dict[str, Any]]:
    assert done.out, done.err
    motors = [one for one in json.loads(done.out)["verdicts"] if one["subject"] == "motor"]
    assert {one["condition"] for one in motors} == {"normal"}
    return [item for one in motors for item in one["indicators"] if item["fault"] == "heating"]


def test_the_store_shows_which_esc_runs_hot(run: Run, tmp_path: Path) -> None:
    history = ("--store", str(tmp_path / "flights"), "--aircraft", "=Q-H", "--keep")
    for day in range(3):
        run("analyse", log(tmp_path / f"{day}.BIN", day), *history)
    shown = heating(run("analyse", log(tmp_path / "4.BIN", 4), "--json", *history))
    assert [item["baseline_flights"] for item in shown] == [3] * 4
    told = run("analyse", log(tmp_path / "5.BIN", 5, 2.5), *history).out
    words = " ".join(told.split())
    assert "motor 3 (front left): its ESC runs hot for its load" in words
    assert "blocked cooling, a dragging bearing or a worn contact" in words
    assert "inspect the ESC, its cooling and contacts, and the bearings of motor 3" in words
    trend = run("trend", "Q-H", "--fault", "heating", "--store", str(tmp_path / "flights")).out
    assert "warming of the ESC by its load, beside the others" in trend


def test_a_radio_link_shows_the_same_and_no_temperature_nothing(run: Run, tmp_path: Path) -> None:
    both = [heating(run("analyse", log(tmp_path / name, 1), "--json")) for name in ("1.BIN", "1.tlog")]
    on_board, sent = ([item["value"]["estimate"] for item in shown] for shown in both)
    assert sent == pytest.approx(on_board, rel=0.05)
    flown = fly(CRAFT, draw_plan(np.random.default_rng([1, 2]), 180.0), 1)
    write_tlog(flown, tmp_path / "cold.tlog", Rates(esc=2.0), 1)
    assert heating(run("analyse", tmp_path / "cold.tlog", "--json")) == []
