"""Rows and priors of the equations with a data sheet, computed by hand for an actuator of round constants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.health.estimation.equations.data_sheet import GEAR, SUPPLY, TORQUE, TORQUE_PER_SAMPLE, VOLTAGE
from mavhums.health.estimation.equations.interface import load_friction_prior
from mavhums.health.estimation.motion import Motion
from tests.health.builders import samples

Array = NDArray[np.float64]
ROUND: dict[str, Any] = {
    "gear_ratio": 100.0,
    "torque_constant": 0.01,
    "resistance": 20.0,
    "stiffness": 400.0,
    "viscous": 0.5,
    "load_friction": 0.0,
}


def actuator_of(esc_side: str = "motor", **constants: float | None) -> Actuator:
    paper = load_airframe("paper").actuators[0]
    ema = paper.known_ema().model_copy(update={**ROUND, **constants})
    return paper.model_copy(update={"ema": ema, "esc_side": esc_side})


def motion_of(
    count: int, speed: float = 2.0, load: float = 0.0, magnitudes: Array | None = None, **values: Any
) -> Motion:
    """Return samples in motion at one speed, rad/s, with these quantities; the others are not measured."""
    return Motion(
        moving=np.ones(count, dtype=bool),
        speed=np.full(count, speed),
        acceleration=np.full(count, 7.0),
        speed_around=np.full(count, 3.0),
        values=samples(count, **values),
        behind=np.full(count, np.nan),
        bus_v=np.full(count, np.nan),
        angles=np.ones((count, 2), dtype=bool),
        turned=np.zeros(count, dtype=bool),
        magnitudes=np.full((count, 3), np.nan) if magnitudes is None else magnitudes,
        load=np.full(count, load),
    )


@pytest.mark.parametrize(
    ("values", "torque", "angle"),
    [
        ({"V5": 0.5, "V1": 20.0}, 0.5, 20.0),  # N·k_t = 1 N·m/A
        ({"V5": 0.5, "V1": 20.0, "V3": 30.0}, 0.5, 30.0),
        ({"V5": 0.5, "V3": 30.0, "V11": 0.2}, 0.3, 0.0),  # a measured load leaves none to the angle
        ({"V5": 0.5, "V8": 0.004, "V3": 0.0}, 0.5, 0.0),
        ({"V4": 12.0, "V8": 0.004, "V3": 0.0}, 0.4, 0.0),  # N·V8
        ({"V4": 12.0, "V3": 0.0}, 0.5, 0.0),  # (12 V − 1 V·s/rad · 2 rad/s) / 20 Ω
    ],
)
def test_the_torque_is_that_of_the_best_source(values: dict[str, Any], torque: float, angle: float) -> None:
    X, y, _ = TORQUE.rows(actuator_of(), motion_of(1, **values))
    assert y == pytest.approx([torque])
    assert X[0] == pytest.approx([1.0, 7.0, 1.0, 3.0, np.radians(angle), 0.0])


def test_friction_by_load_acts_on_the_sine_of_the_angle() -> None:
    seen = motion_of(1, speed=-2.0, load=-0.4, V5=0.5, V3=30.0)
    X, _, _ = TORQUE.rows(actuator_of(load_friction=0.2), seen)
    assert X[0] == pytest.approx([-1.0, 7.0, 1.0, 3.0, 0.5, -0.4])


@pytest.mark.parametrize(("times", "usable"), [(0.99, False), (1.01, True), (-0.99, False), (-1.01, True)])
def test_a_single_sample_counts_from_the_moving_speed(times: float, usable: bool) -> None:
    speed = times * np.radians(1.0)
    X, y, counts = TORQUE_PER_SAMPLE.rows(actuator_of(), motion_of(1, speed=speed, V5=0.5, V3=30.0))
    assert X[0] == pytest.approx([np.sign(times), 1.0, np.radians(30.0), 0.0])
    assert y == pytest.approx([0.5 - 0.5 * speed])
    assert counts.tolist() == [usable]


def test_the_winding_is_seen_at_standstill_by_magnitudes_alone() -> None:
    """0.6 V are 0.03 A through 20 Ω; up to the moving speed the shaft is at rest."""
    still = actuator_of().moving_speed_rev_min
    magnitudes = np.array(
        [[4.0, 0.2, still], [4.0, 0.2, still * 1.01], [0.6, 0.03, 0.0], [0.61, 0.03, 0.0], [4.0, np.nan, 0.0]]
    )
    X, y, usable = VOLTAGE.rows(actuator_of(), motion_of(5, magnitudes=magnitudes))
    assert usable.tolist() == [True, False, False, True, False]
    assert y[usable].tolist() == [4.0, 0.61]
    assert X[usable].tolist() == [[0.2, 0.0, 0.0], [0.03, 0.0, 0.0]]
    signed = motion_of(5, magnitudes=magnitudes, V4=-5.0, V5=-0.1)
    X, y, usable = VOLTAGE.rows(actuator_of(), signed)
    assert usable.all()
    assert X.tolist() == [[-0.1, 2.0, 1.0]] * 5
    assert y.tolist() == [-5.0] * 5


@pytest.mark.parametrize(
    ("behind", "deg_s", "side", "shows"),
    [
        (5.1, 49.0, "motor", True),
        (-5.1, -49.0, "motor", True),
        (5.1, 51.0, "motor", False),  # so fast it needs no more voltage
        (40.0, 95.0, "motor", False),
        (4.9, 49.0, "motor", False),
        (5.1, 49.0, "bus", False),
    ],
)
def test_a_shaft_that_lags_and_is_slow_shows_the_supply(
    behind: float, deg_s: float, side: str, *, shows: bool
) -> None:
    """The actuator moves at 100 °/s and lags by 5° there."""
    seen = motion_of(1, speed=np.radians(deg_s), V4=-8.0)._replace(behind=np.array([behind]))
    _, y, usable = SUPPLY.rows(actuator_of(side), seen)
    assert (usable.tolist(), y[usable].tolist()) == ([shows], [8.0] * shows)


@pytest.mark.parametrize(
    ("load", "speed", "certain"),
    [(0.374, 2.0, True), (0.374, -2.0, False), (0.376, -2.0, True), (-0.376, 2.0, True), (-0.1, 2.0, False)],
)
def test_the_flank_is_certain_under_a_large_load_or_one_that_opposes(
    load: float, speed: float, certain: bool
) -> None:
    """The normal friction is 0.375 N·m."""
    X, y, usable = GEAR.rows(actuator_of(), motion_of(1, speed=speed, V2=1000.0, V3=10.5, V11=load))
    assert X.tolist() == [[np.sign(load), load, np.sign(speed), 1.0]]
    assert y == pytest.approx([0.5])
    assert usable.tolist() == [certain]


def test_an_unknown_friction_by_load_may_be_any_up_to_that_of_a_screw_that_holds_its_load() -> None:
    """A gear that loses half of the load holds it by itself; all below are as likely."""
    drawn = np.random.default_rng(0).uniform(0.0, 0.5, 100_000)
    prior = load_friction_prior(actuator_of(load_friction=None).known_ema())
    assert prior == pytest.approx((drawn.mean(), drawn.std()), rel=0.01)
