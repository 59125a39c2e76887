"""Rows and priors of the equations with a data sheet, computed by hand for an actuator of round constants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.core.quantities import column
from mavhums.health.estimation.equations.data_sheet import (
    GEAR,
    SUPPLY,
    TORQUE,
    TORQUE_PER_SAMPLE,
    VOLTAGE,
    Load,
)
from mavhums.health.estimation.equations.interface import SlotLoad
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import COLUMNS, Slots

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
    V = np.full((count, 12), np.nan)
    for key, given in values.items():
        V[:, column(key)] = given
    moving = np.full(count, speed)
    return Motion(
        moving=np.ones(count, dtype=bool),
        speed=moving,
        acceleration=np.full(count, 7.0),
        speed_around=np.full(count, 3.0),
        values=V,
        behind=np.full(count, np.nan),
        bus_v=np.full(count, np.nan),
        apart=np.ones(count, dtype=bool),
        turned=np.zeros(count, dtype=bool),
        magnitudes=np.full((count, 3), np.nan) if magnitudes is None else magnitudes,
        load=np.full(count, load),
    )


@pytest.mark.parametrize(
    ("values", "torque", "angle"),
    [
        ({"V5": 0.5, "V3": 30.0}, 0.5, 30.0),  # N·k_t = 1 N·m/A
        ({"V5": 0.5, "V3": 30.0, "V11": 0.2}, 0.3, 0.0),  # a measured load leaves none to the angle
        ({"V5": 0.5, "V1": 20.0}, 0.5, 20.0),
        ({"V5": 0.5, "V1": 20.0, "V3": 30.0}, 0.5, 30.0),
        ({"V8": 0.004, "V3": 0.0}, 0.4, 0.0),  # N·V8
        ({"V5": 0.5, "V8": 0.004, "V3": 0.0}, 0.5, 0.0),
        ({"V4": 12.0, "V8": 0.004, "V3": 0.0}, 0.4, 0.0),
        ({"V4": 12.0, "V3": 0.0}, 0.5, 0.0),  # (12 V − 1 V·s/rad · 2 rad/s) / 20 Ω
        ({"V4": 12.0, "V5": 0.3, "V3": 0.0}, 0.3, 0.0),
    ],
)
def test_the_torque_is_that_of_the_best_source(values: dict[str, Any], torque: float, angle: float) -> None:
    X, y, usable = TORQUE.rows(actuator_of(), motion_of(1, **values))
    assert y == pytest.approx([torque])
    assert X[0] == pytest.approx([1.0, 7.0, 1.0, 3.0, np.radians(angle), 0.0])
    assert usable.all()


def test_at_the_bus_a_voltage_shows_no_current() -> None:
    for side, known in (("bus", False), ("motor", True)):
        _, y, usable = TORQUE.rows(actuator_of(side), motion_of(1, V4=12.0, V3=0.0))
        assert (bool(usable[0]), bool(np.isfinite(y[0]))) == (known, known)


def test_friction_by_load_acts_on_the_sine_of_the_angle() -> None:
    seen = motion_of(1, speed=-2.0, load=-0.4, V5=0.5, V3=30.0)
    X, _, _ = TORQUE.rows(actuator_of(load_friction=0.2), seen)
    assert X[0] == pytest.approx([-1.0, 7.0, 1.0, 3.0, 0.5, -0.4])
    unknown = motion_of(1, load=np.nan, V5=0.5, V3=30.0)
    assert not TORQUE.rows(actuator_of(load_friction=0.2), unknown)[2].any()


@pytest.mark.parametrize(("times", "usable"), [(0.99, False), (1.01, True), (-0.99, False), (-1.01, True)])
def test_a_single_sample_counts_from_the_moving_speed(times: float, usable: bool) -> None:
    speed = times * np.radians(1.0)
    X, y, counts = TORQUE_PER_SAMPLE.rows(actuator_of(), motion_of(1, speed=speed, V5=0.5, V3=30.0))
    assert X[0] == pytest.approx([np.sign(times), 1.0, np.radians(30.0), 0.0])
    assert y == pytest.approx([0.5 - 0.5 * speed])
    assert counts.tolist() == [usable]


def test_the_winding_is_seen_at_standstill_by_magnitudes_alone() -> None:
    """0.6 V are 0.03 A through 20 Ω; up to the moving speed the shaft stands."""
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


def test_the_priors_of_the_winding_and_the_supply() -> None:
    prior = VOLTAGE.prior(actuator_of())
    assert prior.mean == pytest.approx([20.0, 1.0, 0.0])
    assert prior.deviation == pytest.approx([4.0, 0.1, np.inf])
    assert SUPPLY.prior(actuator_of()).deviation.tolist() == [np.inf]
    seen = motion_of(2)._replace(bus_v=np.array([26.0, np.nan]))
    X, y, usable = SUPPLY.rows(actuator_of(), seen)
    assert (X.tolist(), y[0], usable.tolist()) == ([[1.0], [1.0]], 26.0, [True, False])


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


@pytest.mark.parametrize("without", ["moving", "apart"])
def test_a_gear_needs_motion_and_two_sensors(without: str) -> None:
    seen = motion_of(1, V2=1000.0, V3=10.5, V11=1.0)
    assert GEAR.rows(actuator_of(), seen)[2].all()
    assert not GEAR.rows(actuator_of(), seen._replace(**{without: np.zeros(1, dtype=bool)}))[2].any()


def test_play_and_wind_up_lie_between_zero_and_their_bounds() -> None:
    """Half the mean of an even distribution of width w is w/2, its deviation w/√12."""
    widths = np.array([0.15, 2.0 * np.degrees(1 / 400.0), np.degrees(0.375 / 400.0)])
    prior = GEAR.prior(actuator_of())
    assert prior.mean == pytest.approx([*(-widths / 2), 0.0])
    assert prior.deviation == pytest.approx([*(widths / 12**0.5), np.inf])
    assert GEAR.prior(actuator_of(stiffness=None)).deviation.tolist()[1:] == [np.inf] * 3


def slots_of(index: list[int], count: int) -> Slots:
    """Return slots of as many samples, all of them judged."""
    size = count * len(index)
    start = count * np.arange(len(index))
    time_s = np.repeat(np.array(index, float), count) + np.tile(np.arange(count) / count, len(index))
    return Slots(np.array(index), start, slice(0, size), time_s, np.full((size, COLUMNS), np.nan))


def test_the_load_of_a_slot_is_that_of_the_slots_before_once_both_ways_are_seen() -> None:
    """y = sgn(w) + 3: the load is the offset, known after forty samples each way."""
    way = np.tile([1.0, -1.0], 20)
    X = np.stack([way, np.ones(40)], axis=1)
    load = SlotLoad(Prior(np.zeros(2), np.full(2, np.inf)), (1,))
    found = [
        load.feed(slots_of([k], 40), X, X @ np.array([1.0, 3.0]), np.ones(40, dtype=bool)) for k in range(4)
    ]
    assert [bool(np.isfinite(one).all()) for one in found] == [False, False, False, True]
    assert found[3] == pytest.approx(np.full(40, 3.0), rel=1e-6)
    one_way = SlotLoad(Prior(np.zeros(2), np.full(2, np.inf)), (1,))
    forward = np.ones((400, 2))
    for k in range(3):
        assert np.isnan(
            one_way.feed(slots_of([k], 400), forward, np.full(400, 4.0), np.ones(400, bool))
        ).all()


def test_the_mean_load_is_that_of_the_samples_in_motion() -> None:
    load = Load(actuator_of(load_friction=0.2))
    assert load.mean is None
    seen = motion_of(4, V5=0.5, V3=10.0, V11=[0.1, -0.3, 9.0, np.nan])
    seen = seen._replace(moving=np.array([True, True, False, True]))
    found = load.feed(slots_of([0], 4), seen)
    assert found.load[:3].tolist() == [0.1, -0.3, 9.0]
    assert load.mean == pytest.approx(0.2)
    rigid = Load(actuator_of())
    assert rigid.feed(slots_of([0], 4), seen) is seen
    assert rigid.mean is None
