"""The torque balance against motions whose friction is known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.actuator import load_airframe
from mavhums.health.friction import Moments, estimate_friction, friction_moments
from mavhums.health.motion import Motion, motion
from mavhums.health.slots import Slot
from mavhums.quantities import column

ACTUATOR = load_airframe("paper").actuators[0]
EMA = ACTUATOR.known_ema()
Array = NDArray[np.float64]


def synthetic(
    friction: float,
    *,
    noise: float = 0.0,
    seed: int = 0,
    rate_hz: float = 100.0,
    seconds: int = 10,
    v11: bool = True,
) -> list[Slot]:
    """Slots in which the torque balance holds exactly, plus white noise in the torque."""
    rng = np.random.default_rng(seed)
    slots = []
    for index in range(seconds):
        t: Array = index + (np.arange(round(rate_hz), dtype=np.float64) + 0.5) / rate_hz
        angle = 0.3 * np.sin(2.1 * t) + 0.1 * np.sin(5.3 * t)
        speed = 0.63 * np.cos(2.1 * t) + 0.53 * np.cos(5.3 * t)
        acceleration = -1.323 * np.sin(2.1 * t) - 2.809 * np.sin(5.3 * t)
        load = 4.0 * angle + 0.2
        torque = friction * np.sign(speed) + ACTUATOR.inertia_output * acceleration + load
        values = np.full((t.size, 12), np.nan)
        values[:, column("V3")] = np.degrees(angle)
        values[:, column("V7")] = speed / ACTUATOR.rad_s(1.0)
        values[:, column("V8")] = (torque + noise * rng.standard_normal(t.size)) / EMA.gear_ratio
        if v11:
            values[:, column("V11")] = load
        slots.append(Slot(index, t, values))
    return slots


def moments(slots: list[Slot]) -> list[Moments]:
    seen = [motion(ACTUATOR, slot) for slot in slots]
    return [friction_moments(ACTUATOR, part) for part in seen if part is not None]


@given(st.floats(0.05, 2.0), st.booleans())
@settings(max_examples=30, deadline=None)
def test_exact_data_give_the_exact_friction(friction: float, v11: bool) -> None:
    estimate = estimate_friction(moments(synthetic(friction, v11=v11)), torque_uncertainty=0.0)
    assert estimate is not None
    assert estimate.estimate == pytest.approx(friction, rel=2e-3)


def test_the_current_serves_where_the_rotor_torque_is_not_measured() -> None:
    slots = synthetic(0.4)
    for slot in slots:
        slot.values[:, column("V5")] = slot.values[:, column("V8")] / EMA.torque_constant
        slot.values[:, column("V8")] = np.nan
    estimate = estimate_friction(moments(slots), 0.0)
    assert estimate is not None
    assert estimate.estimate == pytest.approx(0.4, rel=2e-3)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    inside = 0
    for seed in range(400):
        estimate = estimate_friction(moments(synthetic(0.4, noise=0.3, seed=seed, rate_hz=25.0)), 0.0)
        assert estimate is not None
        inside += estimate.low <= 0.4 <= estimate.high
    assert 0.92 <= inside / 400 <= 0.98


def test_the_interval_is_the_jackknifes() -> None:
    """The same numbers by refitting with each second left out, on the samples themselves."""
    slots = synthetic(0.4, noise=0.3, rate_hz=25.0)
    seen = [part for part in (motion(ACTUATOR, slot) for slot in slots) if part is not None]

    def fit(parts: list[Motion]) -> float:
        rows = [(part, part.moving) for part in parts]
        X = np.concatenate([np.c_[np.sign(p.speed), p.acceleration, np.ones(len(m))][m] for p, m in rows])
        torque = [p.values[:, column("V8")] * EMA.gear_ratio - p.values[:, column("V11")] for p, _ in rows]
        y = np.concatenate([t[m] for t, (_, m) in zip(torque, rows, strict=True)])
        return float(np.linalg.lstsq(X, y)[0][0])

    without = np.array([fit([*seen[:k], *seen[k + 1 :]]) for k in range(10)])
    error = np.sqrt(9 / 10 * np.sum((without - without.mean()) ** 2))
    estimate = estimate_friction([friction_moments(ACTUATOR, part) for part in seen], 0.0)
    assert estimate is not None
    assert estimate.estimate == pytest.approx(fit(seen))
    assert estimate.high - estimate.estimate == pytest.approx(2.262157 * error)


def test_the_torque_scale_widens_the_interval() -> None:
    narrow = estimate_friction(moments(synthetic(0.4)), 0.0)
    wide = estimate_friction(moments(synthetic(0.4)), 0.05)
    assert narrow is not None
    assert wide is not None
    assert (wide.high - wide.low) - (narrow.high - narrow.low) == pytest.approx(2 * 0.05 * 0.4, rel=1e-2)


def test_what_cannot_show_friction_is_not_estimated() -> None:
    moving = synthetic(0.4)
    assert estimate_friction([], 0.0) is None
    assert estimate_friction(moments(moving[:3]), 0.0) is None
    one_way = synthetic(0.4)
    for slot in one_way:
        slot.values[:, column("V7")] = np.abs(slot.values[:, column("V7")]) + 100.0
    assert estimate_friction(moments(one_way), 0.0) is None
    standing = synthetic(0.4)
    for slot in standing:
        slot.values[:, column("V7")] = 0.0
    assert estimate_friction(moments(standing), 0.0) is None
    half = synthetic(0.4)
    for slot in half[5:]:
        slot.values[:, column("V11")] = np.nan
    assert estimate_friction(moments(half), 0.0) is None
    blind = synthetic(0.4)
    for slot in blind:
        slot.values[:, column("V8")] = np.nan
    assert estimate_friction(moments(blind), 0.0) is None


def test_few_samples_are_too_few() -> None:
    assert estimate_friction(moments(synthetic(0.4, rate_hz=3.0, seconds=6)), 0.0) is None


def test_motion_needs_neighbours_that_turn_the_same_way() -> None:
    values = np.zeros((6, 12))
    values[:, column("V7")] = [100, 100, 100, -100, -100, -100]
    seen = motion(ACTUATOR, Slot(0, np.arange(6) / 10, values))
    assert seen is not None
    assert seen.moving.tolist() == [True, False, False, True]
    gap = motion(ACTUATOR, Slot(0, np.array([0.0, 0.1, 0.2, 0.9, 1.0, 1.1]), np.abs(values)))
    assert gap is not None
    assert gap.moving.tolist() == [True, False, False, True]
    assert motion(ACTUATOR, Slot(0, np.array([0.0, 0.1]), values[:2])) is None
