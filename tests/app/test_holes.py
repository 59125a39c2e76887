"""A log that lost some parameters raises no alarm that the whole log does not raise."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from mavhums import analyse
from mavhums_sim.multirotor.craft import draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import write_dataflash

HOLES = Path(__file__).parents[2] / "benchmarks" / "holes.py"


@pytest.mark.slow
def test_holes_in_the_parameters_make_no_alarm() -> None:
    assert runpy.run_path(str(HOLES))["main"]([]) == 0


@pytest.mark.slow
def test_a_missing_parameter_leaves_the_motors_undecided(tmp_path: Path) -> None:
    rng, path = np.random.default_rng(3), tmp_path / "quad.BIN"
    write_dataflash(fly(draw_craft(rng, "quad x"), draw_plan(rng, 60.0), 3), path)
    assert {one.condition for one in analyse(path).verdicts if one.subject == "motor"} == {"normal"}
    path.write_bytes(path.read_bytes().replace(b"MOT_PWM_MAX", b"~OT_PWM_MAX"))
    [motors] = [one for one in analyse(path).verdicts if one.subject == "motor"]
    assert motors.condition == "undecided"
    assert motors.reason == "the log lacks the parameter MOT_PWM_MAX, so what each motor does is not known"
