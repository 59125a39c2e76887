"""Quantities that a log repeats, and currents without a sign, are not samples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.actuator.plausibility import Freshness
from mavhums.core.arrays import Array, Integers
from mavhums.core.quantities import KEYS, column

V3, V4, V5, V7 = (column(key) for key in ("V3", "V4", "V5", "V7"))
MIN_HZ = 5.0


def swept(seconds: float = 20.0, rate_hz: float = 100.0) -> tuple[Integers, Array]:
    """Times and V1…V12 of an arm that swings under its weight: angle, voltage, current and speed."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    rng = np.random.default_rng(34)
    values = np.full((t.size, len(KEYS)), np.nan)
    # It rests at either end.
    phase = np.clip(1.6 * np.sin(1.5 * t), -1.0, 1.0)
    values[:, V3] = np.round(60.0 * phase, 2)
    values[:, V7] = np.round(np.gradient(60.0 * phase, t) * 50.0)
    values[:, V5] = np.sin(np.radians(values[:, V3])) + 0.01 * rng.standard_normal(t.size)
    values[:, V4] = 4.0 * values[:, V5] + 0.0005 * values[:, V7]
    return (t * 1e6).astype(np.int64), values


def held(values: Array, every: int) -> Array:
    """The current as a register that is refreshed with every n-th sample."""
    register = values.copy()
    register[:, V5] = np.repeat(values[::every, V5], every)[: len(values)]
    return register


def test_a_sampled_current_is_evidence() -> None:
    time_us, values = swept()
    freshness = Freshness(MIN_HZ)
    assert not freshness.feed(time_us, values).any()
    assert freshness.reasons() == {}


@pytest.mark.parametrize("rate_hz", [10.0, 25.0, 100.0])
def test_a_register_that_is_refreshed_once_a_second_is_none(rate_hz: float) -> None:
    time_us, values = swept(rate_hz=rate_hz)
    freshness = Freshness(MIN_HZ)
    register = held(values, round(rate_hz))
    refused = freshness.feed(time_us, register)
    repeated = np.diff(register[:, V5], prepend=np.nan) == 0.0
    # From the first sample on no repetition in motion is evidence.
    assert refused[repeated & (np.diff(values[:, V7], prepend=0.0) != 0.0), V5].all()
    assert refused[time_us > 6e6, V5].all()
    assert not refused[:, [V3, V4, V7]].any()
    assert freshness.reasons() == {"V5": "the current is refreshed once a second"}


def test_a_current_in_coarse_steps_is_sampled() -> None:
    time_us, values = swept()
    values[:, V5] = np.round(values[:, V5], 2)
    assert not Freshness(MIN_HZ).feed(time_us, values)[time_us > 6e6].any()


def test_a_slow_log_is_not_a_stale_one() -> None:
    time_us, values = swept(rate_hz=4.0)
    assert not Freshness(MIN_HZ).feed(time_us, values).any()


def test_a_servo_at_rest_repeats_itself_and_hides_nothing() -> None:
    time_us, values = swept()
    values[:] = values[0]
    values[:, V7] = 0.0
    assert not Freshness(MIN_HZ).feed(time_us, values).any()


def test_a_current_that_is_positive_at_either_voltage_has_no_sign() -> None:
    time_us, values = swept()
    values[:, V5] = np.abs(values[:, V5])
    freshness = Freshness(MIN_HZ)
    refused = freshness.feed(time_us, values)
    assert refused[time_us > 8e6, V5].all()
    assert freshness.reasons() == {"V5": "the current has no sign"}


@pytest.mark.parametrize("offset", [0.2, 0.5])
def test_a_load_that_keeps_the_current_positive_is_no_missing_sign(offset: float) -> None:
    time_us, values = swept()
    values[:, V5] = offset + 0.1 * values[:, V5]
    values[:, V4] = 4.0 * values[:, V5] + 0.001 * values[:, V7]
    assert Freshness(MIN_HZ).feed(time_us, values).sum() == 0


@given(st.lists(st.integers(1, 1999), max_size=6, unique=True), st.sampled_from([1, 100]))
@settings(max_examples=30, deadline=None)
def test_blocks_do_not_matter(cuts: list[int], every: int) -> None:
    time_us, values = swept()
    values = held(values, every)
    values[:, V5] = np.abs(values[:, V5])
    whole, blocks = Freshness(MIN_HZ), Freshness(MIN_HZ)
    expected = whole.feed(time_us, values)
    edges = [0, *sorted(cuts), len(values)]
    got = [blocks.feed(time_us[a:b], values[a:b]) for a, b in pairwise(edges)]
    assert np.array_equal(np.concatenate(got), expected)
    assert blocks.reasons() == whole.reasons()
