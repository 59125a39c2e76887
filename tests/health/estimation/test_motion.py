"""Motion, its slopes and the columns beside V1…V12, on samples that can be judged by eye."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.actuator.profile import load_airframe
from mavhums.core.quantities import MOMENTS, column, products
from mavhums.health.estimation.motion import angle_speed, central_slope, lasting, motion, window_sums
from mavhums.health.estimation.slots import BUS, ROTOR_SENSED, SENSED, SHAFT, TURNED, with_extra_columns
from tests.health.builders import one_slot, samples

FAST, SLOW = 2.0, 1.0


def moving(time_s: list[float], speed: list[float], gap_s: float = 0.5) -> list[bool]:
    return [bool(one) for one in lasting(np.array(time_s), np.array(speed), SLOW, gap_s)]


def test_a_sample_counts_in_a_motion_that_lasts_on_either_side() -> None:
    """The guard is 0.06 s, itself included."""
    time_s = [0.0, 0.03, 0.06, 0.09, 0.12, 0.15]
    assert moving(time_s, [FAST] * 6) == [False, False, True, True, False, False]
    assert moving(time_s, [-FAST] * 6) == [False, False, True, True, False, False]
    assert moving([0.0, 0.03, 0.059, 0.09, 0.12], [FAST] * 5) == [False] * 5
    assert moving(time_s, [FAST, FAST, FAST, FAST, -FAST, -FAST]) == [False] * 6


def test_slow_samples_and_a_fast_one_between_them_do_not_count() -> None:
    time_s = (0.1 * np.arange(7)).tolist()
    assert moving(time_s, [SLOW] * 7) == [False] * 7, "the threshold itself is not motion"
    speed = [FAST, FAST, FAST, 0.5, FAST, 0.5, FAST]
    assert moving(time_s, speed) == [False, True, False, False, False, False, False]


def test_a_gap_ends_a_motion_where_it_is_longer_than_allowed() -> None:
    time_s, speed = [0.0, 0.1, 0.2, 0.7, 0.8, 0.9], [FAST] * 6
    assert moving(time_s, speed, 0.5) == [False, True, True, True, True, False]
    assert moving(time_s, speed, 0.49) == [False, True, False, False, True, False]


def test_a_slope_over_neighbours_is_that_of_a_parabola() -> None:
    time_s = np.array([0.0, 0.1, 0.3, 0.6])
    slope, span = central_slope(time_s, 3.0 * time_s**2 - time_s)
    # The chord of a·t² between s and t has the slope a·(s + t).
    assert slope[1:3] == pytest.approx([3.0 * 0.3 - 1.0, 3.0 * 0.7 - 1.0])
    assert span[1:3] == pytest.approx([0.3, 0.5])
    assert np.isnan([slope[0], slope[-1], span[0], span[-1]]).all()


def test_the_speed_of_an_angle_is_the_slope_over_the_time_on_either_side() -> None:
    time_s = np.array([0.0, 0.01, 0.02, 0.04, 0.07, 0.2, 0.3])
    angle = np.array([0.0, 1.0, -1.0, 2.0, 0.5, 1.0, 4.0])
    found = angle_speed(time_s, angle, 0.02)
    for k, part in ((1, slice(0, 3)), (2, slice(0, 4)), (3, slice(2, 5)), (4, slice(3, 6)), (5, slice(4, 7))):
        assert found[k] == pytest.approx(np.polyfit(time_s[part], angle[part], 1)[0])
    assert np.isnan(found[[0, -1]]).all()


def test_motion_is_that_of_the_output_shaft_at_the_judged_samples() -> None:
    """At 60 rev/min of the rotor the paper's output shaft turns by 60/300 rev/min."""
    actuator = load_airframe("paper").actuators[0]
    time_s = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    values = samples(6, V7=[60.0, 60.0, 66.0, 66.0, 66.0, 66.0])
    found = motion(actuator, one_slot(time_s, values, slice(1, 5)))
    unit = 2 * np.pi / 60.0 / 300.0
    assert found.speed == pytest.approx(np.array([60.0, 66.0, 66.0, 66.0]) * unit)
    assert found.acceleration == pytest.approx(np.array([30.0, 30.0, 0.0, 0.0]) * unit)
    assert found.speed_around == pytest.approx(np.array([63.0, 63.0, 66.0, 66.0]) * unit)
    assert found.moving.all()
    assert not found.load.any()
    # Two and a half periods of 5 Hz: neighbours more than half a second apart show no acceleration.
    assert not motion(actuator, one_slot(2.6 * time_s, values, slice(1, 5))).moving.any()


@pytest.mark.parametrize(
    ("derived", "shaft", "rotor", "sensed", "turned"),
    [
        (["V2"], 2.0, 0.0, 1.0, 0.0),
        (["V3"], 2.0, 1.0, 0.0, 0.0),
        (["V7"], 2.0, 1.0, 1.0, 1.0),
        (["V7", "V10"], 2.0, 1.0, 1.0, 0.0),
        (["V2", "V3"], 2.0, 0.0, 0.0, 0.0),
        (["V2", "V3", "V7"], np.nan, 0.0, 0.0, 1.0),  # an angle whose sign follows the command
    ],
)
def test_what_is_derived_is_not_measured(
    derived: list[str], shaft: float, rotor: float, sensed: float, turned: float
) -> None:
    measured = np.ones((1, 12), dtype=bool)
    measured[0, [column(key) for key in derived]] = False
    [row] = with_extra_columns(np.arange(12.0)[None], measured)
    np.testing.assert_array_equal(row[[SHAFT, ROTOR_SENSED, SENSED, TURNED]], [shaft, rotor, sensed, turned])


def test_values_beyond_the_plausible_are_missing() -> None:
    values = np.zeros((1, 12))
    values[0, :4] = 0.99e9, 1e9, -1e9, np.inf
    [row] = with_extra_columns(values, bus_v=np.array([2e9]))
    assert np.isfinite(row[:5]).tolist() == [True, False, False, False, True]
    assert np.isnan(row[BUS])


@pytest.mark.parametrize(("known", "carried"), [(6, True), (5, False)])
def test_a_quantity_that_half_of_the_samples_in_motion_have_is_carried(known: int, carried: bool) -> None:
    """Samples without it do not count then; a quantity that fewer have has no sums, and all samples count."""
    actuator = load_airframe("paper").actuators[0]
    rng = np.random.default_rng(1)
    speed = np.where(np.arange(18) < 14, rng.uniform(90.0, 120.0, 18), 0.0)
    values = samples(18, V7=speed, V3=rng.standard_normal(18))
    values[14:, column("V11")] = 1.0
    values[1 : 1 + known, column("V11")] = rng.standard_normal(known)
    slots = one_slot(np.arange(18) / 10.0, values, slice(1, 17))
    moved = motion(actuator, slots)
    assert np.flatnonzero(moved.moving).tolist() == [*range(12)]
    places = {name: MOMENTS.index(name) for name in ("1", "V3", "V11")}
    moments = np.full((12, len(MOMENTS)), np.nan)
    moments[:, [*places.values()]] = np.column_stack([np.ones(12), values[1:13, [2, 10]]])
    counted = slice(0, known if carried else 12)
    expected = products(moments[counted])
    found = window_sums(actuator, slots, moved)[0, : expected.shape[1]]
    known_sums = np.isfinite(expected).all(axis=0)
    assert known_sums.sum() == (6 if carried else 3)
    assert found[known_sums] == pytest.approx(expected.sum(axis=0)[known_sums])
    without = products(np.where(np.arange(len(MOMENTS)) == places["V11"], np.nan, 1.0)[None])[0]
    assert np.isnan(found[np.isnan(without)]).all() != carried
