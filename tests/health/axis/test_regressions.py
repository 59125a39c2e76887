"""The columns of the regressions, and the filters before them, against their equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mavhums.health.axis.regressions import FORMS, Basis, Chain, HighPass, Lag, Shape, judgeable
from mavhums.health.axis.residuals import AttitudeResponse
from mavhums.vehicle.grid import RATE_HZ
from tests.health.axis.flights import SPEED, Array, excited, rows, steady, without_level

LEAST_SPEED_SHARE = 0.85
MEAN_ROWS = 8
MOST_BANK_DEG = 60
STEP = np.concatenate([np.zeros(1), np.ones(60)])
TIME_S = np.arange(61) / RATE_HZ


def in_blocks(filter_: Any, values: Array) -> Array:
    return np.concatenate([filter_.feed(part) for part in np.split(values, [1, 7, 30])])


@pytest.mark.parametrize("tau_s", [0.1, 0.65])
def test_first_orders_follow_a_step_exponentially(tau_s: float) -> None:
    assert in_blocks(Lag(tau_s), STEP) == pytest.approx(1.0 - np.exp(-TIME_S / tau_s))
    assert in_blocks(Lag(tau_s), STEP + 3.0)[0] == 3.0, "it begins where the values do"


@pytest.mark.parametrize("tau_s", [0.1, 2.0])
def test_a_high_pass_subtracts_a_mean_that_gaps_age(tau_s: float) -> None:
    rng = np.random.default_rng(3)
    values, known = 5.0 + rng.normal(size=61), (rng.random(61) > 0.3) & (np.abs(np.arange(61) - 30) > 8)
    expected = without_level(values, known, tau_s)
    given = np.where(known, values, np.nan)
    np.testing.assert_allclose(in_blocks(HighPass(tau_s), given), expected, atol=1e-12)
    unit = 1.0 + rng.random(61)
    found = HighPass(tau_s).feed(3.0 * unit, unit)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_a_lag_holds_what_is_missing() -> None:
    lag = Lag(0.0)
    assert lag.feed(np.array([np.nan, 2.0, np.nan, 3.0])).tolist() == [2.0, 2.0, 2.0, 3.0]
    assert lag.feed(np.array([np.nan, np.nan])).tolist() == [3.0, 3.0]
    assert Lag(0.0).feed(np.array([np.nan, np.nan])).tolist() == [0.0, 0.0]


def test_a_controlled_attitude_is_critically_damped_or_as_fast_as_the_aircraft() -> None:
    late = TIME_S - 1.0 / RATE_HZ  # a command shows in the next row
    expected = np.where(late > 0.0, 1.0 - np.exp(-2.5 * late) * (1.0 + 2.5 * late), 0.0)
    assert in_blocks(AttitudeResponse(2.5), STEP) == pytest.approx(expected)
    assert in_blocks(AttitudeResponse(2.5), 0.3 + 0.0 * STEP) == pytest.approx(0.3 + 0.0 * STEP)
    for sign in (1.0, -1.0):
        slewed = in_blocks(AttitudeResponse(1e3, 0.5), sign * STEP)
        assert slewed == pytest.approx(sign * np.clip(0.5 * late, 0.0, 1.0))
    held = AttitudeResponse(2.5).feed(np.array([np.nan, 0.2, np.nan]))
    assert held == pytest.approx([0.2] * 3)
    assert AttitudeResponse(2.5).feed(np.array([np.nan])) == pytest.approx([0.0])


def test_a_reference_rests_on_the_usual_source_in_flight() -> None:
    made = steady(5)
    made["sources"][:] = np.repeat([2.0, 0.0, 1.0, 1.0, 0.0], RATE_HZ)
    made["speed"][:] = np.arange(100.0)
    flown = rows(made)
    flown.flying[80:] = False
    assert Basis.of(flown) == (59.5, 1.0)
    assert Basis.of(rows(made, flying=False)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "last", "beyond"),
    [
        ("speed", LEAST_SPEED_SHARE * SPEED, 0.999 * LEAST_SPEED_SHARE * SPEED),
        ("speed", 99.0, np.nan),
        ("roll", np.radians(MOST_BANK_DEG), np.radians(MOST_BANK_DEG + 0.1)),
        ("roll", -np.radians(MOST_BANK_DEG), -np.radians(MOST_BANK_DEG + 0.1)),
        ("pitch", np.radians(MOST_BANK_DEG), np.radians(MOST_BANK_DEG + 0.1)),
        ("pitch", -np.radians(MOST_BANK_DEG), -np.radians(MOST_BANK_DEG + 0.1)),
        ("roll", 0.0, np.nan),
        ("pitch", 0.0, np.nan),
        ("spacing", 0.84, 0.841),
        ("sources", 0.0, 1.0),
        ("flying", True, False),
        ("trusted", True, False),
    ],
)
def test_rows_within_the_limits_are_judged(name: str, last: float, beyond: float) -> None:
    flown = rows(steady(1))
    getattr(flown, name)[3:5] = last, beyond
    assert np.flatnonzero(~judgeable(flown, Basis(SPEED, 0.0), FORMS["roll"])).tolist() == [4]


@pytest.mark.parametrize(("axis", "judged"), [("roll", True), ("pitch", True), ("yaw", False)])
def test_a_side_force_that_is_rarer_than_outputs_must_be_counts_in_yaw(axis: str, judged: bool) -> None:
    flown = rows(steady(1))
    flown.force_spacing[:] = 0.9
    assert judgeable(flown, Basis(SPEED, 0.0), FORMS[axis]).all() == judged


def random(seconds: int = 20) -> dict[str, Array]:
    """Return a flight all of whose signals are excited, without a response yet."""
    made = steady(seconds)
    for seed, name in enumerate(("roll_rate", "yaw_rate", "load", "roll", "pitch_rate"), 2):
        made[name] = excited(seconds, seed)
    made["speed"] = SPEED * (1.0 + excited(seconds, 8, 0.05))
    made["outputs"] = np.stack([excited(seconds, seed) for seed in (9, 10, 11)], axis=1)
    return made


def delayed(values: Array, row_count: int) -> Array:
    return np.concatenate([np.full(row_count, np.nan), values[: len(values) - row_count]])


@pytest.mark.parametrize(("axis", "bounded"), [("roll", False), ("pitch", True), ("yaw", False)])
def test_pitch_is_not_judged_far_above_the_speed_of_the_reference(axis: str, bounded: bool) -> None:
    made = random()
    made["speed"] = np.where(np.arange(len(made["speed"])) < 200, 22.0, 27.0)
    good = Chain(FORMS[axis], Basis(22.0, 0.0), Shape(0, 0.0)).feed(rows(made)).good
    assert good[20:200].all()
    assert good[220:].any() == (not bounded)


@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize(
    ("axis", "truth"),
    [
        ("roll", [2.2, 0.1, -0.3]),
        ("pitch", [-9.0, 0.4, -2.0, 1.5]),
        ("yaw", [4.0, 0.7, -0.2, 1.1, 0.5, 2.0]),
        ("steering", [1.7, 0.05]),
    ],
)
def test_the_columns_recover_the_coefficients_of_the_axis(axis: str, truth: list[float], delay: int) -> None:
    """Each axis as its equation says, without noise; pitching by the trapezoid rule."""
    made = random()
    made["speed"] = np.minimum(made["speed"], 16.0 / LEAST_SPEED_SHARE)
    v, (a, e, r) = made["speed"] / 16.0, (delayed(one, delay) for one in made["outputs"].T)
    k, *rest = truth
    if axis == "roll":
        made["roll_rate"] = k * v * a + rest[0] * v + rest[1] * made["yaw_rate"]
    elif axis == "steering":
        made["yaw_rate"] = k * v * r + rest[0] * v
    elif axis == "yaw":
        parts = (v**2 * a, v**2, v * made["yaw_rate"], v * made["roll_rate"], np.sin(made["roll"]))
        made["side_force"] = k * v**2 * r + sum(c * part for c, part in zip(rest, parts, strict=True))
    else:
        given = np.nan_to_num(k * v**2 * e + rest[0] * v**2 + rest[2] * made["load"])
        rate, half = np.zeros_like(v), 0.5 / RATE_HZ
        for n in range(1, len(v)):
            before = rate[n - 1] * (1.0 + half * rest[1] * v[n - 1]) + half * (given[n - 1] + given[n])
            rate[n] = before / (1.0 - half * rest[1] * v[n])
        made["pitch_rate"] = rate
    flown = rows(made)
    chain = Chain(FORMS[axis], Basis(16.0, 0.0), Shape(delay, 0.0))
    blocks = [chain.feed(flown.cut(begin, end)) for begin, end in ((0, 1), (1, 8), (8, 20))]
    drive, others, answer, good = (np.concatenate(one) for one in zip(*(b[:4] for b in blocks), strict=True))
    # A mean of rows, of which the first has the delay; a rate of change needs one row more.
    assert np.flatnonzero(good)[0] == MEAN_ROWS - 1 + delay + (axis == "pitch")
    assert good.sum() == len(good) - np.flatnonzero(good)[0]
    settled = np.flatnonzero(good)[10:]
    design = np.column_stack([drive, others])[settled]
    assert np.linalg.lstsq(design, answer[settled], rcond=None)[0] == pytest.approx(truth, rel=1e-6)


def test_a_demand_that_is_missing_leaves_the_mean_unknown() -> None:
    made = random(3)
    made["outputs"][30, 0] = np.nan
    columns = Chain(FORMS["roll"], Basis(16.0, 0.0), Shape(0, 0.0)).feed(rows(made))
    expected = [*range(MEAN_ROWS - 1), *range(30, 30 + MEAN_ROWS)]
    assert np.flatnonzero(~columns.good).tolist() == expected


def test_only_the_servo_of_the_axis_is_slow() -> None:
    made = random(3)
    plain, slow = (
        Chain(FORMS["yaw"], Basis(16.0, 0.0), Shape(0, 0.1), extra).feed(rows(made)) for extra in (0.0, 0.45)
    )
    made["outputs"][:, 2] = Lag(0.45).feed(made["outputs"][:, 2])
    lagged = Chain(FORMS["yaw"], Basis(16.0, 0.0), Shape(0, 0.1)).feed(rows(made))
    at = plain.good
    assert slow.drive[at] == pytest.approx(lagged.drive[at])
    assert slow.others[at] == pytest.approx(plain.others[at])
    assert np.abs(slow.drive - plain.drive)[at].max() > 0.01


def test_rows_that_do_not_follow_begin_anew() -> None:
    chain, made = Chain(FORMS["roll"], Basis(16.0, 0.0), Shape(2, 0.2)), random(3)
    first = chain.feed(rows(made))
    again = chain.feed(rows(made))
    assert again.drive == pytest.approx(first.drive, nan_ok=True)
    assert again.good.tolist() == first.good.tolist()


@pytest.mark.parametrize(
    ("answered", "driven", "wheels"),
    [
        (1.0, 2.0, 0.0),
        (3.0, 2.0, 1.0),
        (-0.5, 2.0, -0.5),
        (-1.0, -2.0, 0.0),
        (-3.0, -2.0, -1.0),
        (0.5, -2.0, 0.5),
    ],
)
def test_a_share_of_the_turn_is_explained_for_wheels(answered: float, driven: float, wheels: float) -> None:
    assert FORMS["steering"].unexplained(answered, driven) == wheels
    assert FORMS["pitch"].unexplained(answered, driven) == answered - driven


def test_in_pitch_a_speed_that_no_turn_has_settled_is_not_judged() -> None:
    flown = rows(random())
    flown.settled[: 10 * RATE_HZ] = False
    for axis, early in (("roll", True), ("pitch", False)):
        good = Chain(FORMS[axis], Basis(16.0, 0.0), Shape(0, 0.0)).feed(flown).good
        assert good[: 10 * RATE_HZ].any() == early
        assert good[10 * RATE_HZ :].any()
