"""A quantity against its limits: what windows show, how soon, how seldom wrongly, and how it ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.decision.limits import Estimates, Levels, LimitTest, half_width, tail_of
from tests.strategies import cuts

Array = NDArray[np.float64]
LEVELS = Levels(0.375, 0.875)
ERROR = 0.02
PROVEN_S = 2.5


def windows(truth: Array, error: float = ERROR, seed: int | None = None) -> Array:
    """Return the estimates of sliding windows of ten slots, without noise if no seed is given."""
    noise = 0.0 if seed is None else np.random.default_rng(seed).normal(0.0, error * 10**0.5, truth.size)
    return np.convolve(truth + noise, np.full(10, 0.1), "valid")


def estimates(values: Array, error: float, freedom: float) -> Estimates:
    return Estimates(values, np.full(values.size, error), np.full(values.size, freedom))


def follow(
    test: LimitTest, values: Array, error: float = ERROR, freedom: float = 45.0, start_s: float = 10.0
) -> list[tuple[float, Condition, float | None]]:
    """Feed windows; return each change: at which window's end, to what, since when."""
    if not values.size:
        return []
    end_s: Array = start_s + np.arange(values.size, dtype=np.float64)
    rows = zip(end_s.tolist(), test.evidence(estimates(values, error, freedom), end_s), strict=True)
    return [(end, test.condition, test.since_s) for end, row in rows if test.feed(end, row)]


@pytest.mark.parametrize(("levels", "condition"), [(Levels(0.375), "degraded"), (Levels(), "undecided")])
def test_a_limit_that_is_absent_is_never_passed(levels: Levels, condition: Condition) -> None:
    test = LimitTest(levels, 1.0)
    follow(test, np.full(30, 9.9))
    assert test.condition == condition
    assert not test.surely_grave(estimates(np.full(1, 9.9), ERROR, 9.0))


@given(st.lists(st.floats(0.0, 1.5), min_size=1, max_size=60), st.data())
def test_where_blocks_end_does_not_matter(values: list[float], data: st.DataObject) -> None:
    whole, places = np.array(values), data.draw(cuts(len(values)))
    end_s: Array = 10.0 + np.arange(whole.size, dtype=np.float64)
    shown = estimates(whole, ERROR, 45.0)
    test = LimitTest(LEVELS, 1.0)
    parts = [test.evidence(shown.at(k), end_s[k]) for k in np.split(np.arange(whole.size), places) if k.size]
    assert np.array_equal(np.concatenate(parts), LimitTest(LEVELS, 1.0).evidence(shown, end_s))


@given(
    st.lists(st.tuples(st.floats(0.0, 1.2), st.floats(0.0, 0.5)), min_size=1, max_size=60),
    st.sampled_from([0.02, 0.2]),
)
def test_larger_values_are_never_milder(values: list[tuple[float, float]], error: float) -> None:
    """Of what windows slide over, and the last value lasts: single ones may leap within a window."""
    worst = []
    for size in ([value for value, _ in values], [value + more for value, more in values]):
        changes = follow(LimitTest(LEVELS, 1.0), windows(np.append(size, np.full(20, size[-1]))), error)
        worst.append(max([SEVERITY[condition] for _, condition, _ in changes], default=-1))
    assert max(worst[0], 0) <= max(worst[1], 0)


def test_changes_count_from_the_window_that_first_speaks_for_them() -> None:
    """The first condition from that window's start, others from its middle."""
    truth = np.repeat([0.2, 0.6, 1.0, 0.2], 40)
    changes = follow(LimitTest(LEVELS, 1.0), windows(truth))
    assert [change[1] for change in changes] == ["normal", "degraded", "emergency", "degraded", "normal"]
    assert changes[0][2] == 0.0
    for (end_s, _, since_s), at_s in zip(changes[1:], (40.0, 80.0, 120.0, 120.0), strict=True):
        assert end_s - at_s <= 13.0
        assert since_s == pytest.approx(at_s, abs=5.0)
    assert follow(LimitTest(LEVELS, 1.0), windows(np.full(60, 1.0)))[0][1:] == ("emergency", 0.0)


def test_power_grows_with_the_distance_from_the_limit() -> None:
    """Delay of a fault that begins at 100 s, by its distance in standard errors."""
    delays = []
    for errors in (2.0, 3.0, 5.0, 10.0):
        truth = np.repeat([0.2, 0.375 + errors * ERROR], [100, 300])
        of_seeds = [follow(LimitTest(LEVELS, 1.0), windows(truth, seed=seed))[1:] for seed in range(10)]
        delays.append(np.mean([changes[0][0] - 100.0 for changes in of_seeds]))
    assert delays == sorted(delays, reverse=True)
    assert delays[0] < 120.0
    assert delays[-1] < 12.0


def test_health_at_its_limit_raises_no_alarm() -> None:
    """Ten hours at the limit itself: promised is one alarm in ten."""
    for seed in range(10):
        test = LimitTest(LEVELS, 10.0)
        follow(test, windows(np.full(3600, 0.375), seed=seed))
        assert test.condition in ("normal", "undecided")


def test_a_doubtful_window_ends_no_fault() -> None:
    test = LimitTest(LEVELS, 1.0)
    follow(test, np.full(30, 0.6))
    assert follow(test, np.full(60, 0.4), 0.1, start_s=40.0) == []
    assert [change[1] for change in follow(test, np.full(100, 0.2), 0.1, start_s=100.0)] == ["normal"]


def test_a_window_that_proves_a_fault_begins_it_at_once_and_at_its_start() -> None:
    """Its value has no error. To end it takes more than one."""
    test = LimitTest(Levels(0.8, 0.8), 1.0, PROVEN_S)
    jammed = follow(test, np.repeat([0.1, 1.0, 0.1], [20, 1, 10]), 0.0, 1.0)
    assert jammed[1] == (30.0, "emergency", 30.0 - PROVEN_S)
    assert jammed[2][1] == "normal"
    assert 31.0 < jammed[2][0] <= 36.0


@pytest.mark.parametrize(
    ("of_windows", "whole", "error", "after"),
    [
        (np.nan, 0.2, 0.02, "normal"),
        (np.nan, 1.2, 0.02, "emergency"),
        (0.2, 0.6, 0.02, "degraded"),
        (0.2, 0.2, 0.02, None),
        (0.6, 0.2, 0.02, None),
        (0.6, 1.2, 0.02, None),
        (np.nan, 0.8, 0.3, None),
    ],
)
def test_the_whole_flight_may_add_a_fault_and_never_ends_one(
    of_windows: float, whole: float, error: float, after: Condition | None
) -> None:
    test = LimitTest(LEVELS, 1.0)
    follow(test, np.full(0 if np.isnan(of_windows) else 30, of_windows))
    before = test.condition, test.since_s
    flight = estimates(np.full(1, whole), error, 9.0)
    assert test.settle(flight, 3.0) == (after is not None)
    assert (test.condition, test.since_s) == ((after, 3.0) if after else before)
    assert test.surely_grave(flight) == (whole == 1.2)


def test_intervals_are_as_wide_as_the_false_alarm_rate_asks() -> None:
    """Of 36,000 windows of 10 s in 100 h, as many may lie beyond the interval as alarms are allowed."""
    of_windows = Estimates(np.zeros(2), np.array([0.1, 0.1]), np.array([9.0, 45.0]))
    for alarms in (0.1, 1.0, 10.0):
        half = half_width(of_windows, tail=tail_of(alarms))
        assert stats.t.sf(half / 0.1, df=[9.0, 45.0]) * 36_000 == pytest.approx([alarms, alarms], rel=1e-6)
