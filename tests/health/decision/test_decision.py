"""The sequential decision: what intervals show, and what several of them change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from mavhums.core.conditions import Condition
from mavhums.health.decision.limits import Decision, Estimates, Levels, bounds, half_width, shown_by, tail_of
from mavhums.health.decision.thresholds import CONFIRM_WINDOWS, LASTING_WINDOWS

LEVELS = Levels(0.375, 0.875)
NOTHING, NORMAL, DEGRADED, EMERGENCY = -1, 0, 1, 2


def follow(shown: Sequence[int]) -> tuple[Decision, list[tuple[Condition, float | None, float]]]:
    """The decision after all windows, and each change: to what, since when, and at which window's end."""
    decision = Decision(LEVELS)
    changes: list[tuple[Condition, float | None, float]] = []
    for k, severity in enumerate(shown):
        if decision.feed(severity, float(k), float(k + 10)):
            changes.append((decision.condition, decision.since_s, k + 10.0))
    return decision, changes


@pytest.mark.parametrize(
    ("low", "high", "severity"),
    [
        (0.2, 0.3, NORMAL),
        (0.37, 0.5, NORMAL),
        (0.375, 0.5, NORMAL),
        (0.38, 0.87, DEGRADED),
        (0.38, 0.875, EMERGENCY),
        (0.3, 0.9, NOTHING),
        (0.9, 1.1, EMERGENCY),
        (np.nan, np.nan, NOTHING),
    ],
)
def test_the_rule_of_the_interval(low: float, high: float, severity: int) -> None:
    assert shown_by(np.array([low]), np.array([high]), *bounds(LEVELS)).tolist() == [severity]


@pytest.mark.parametrize(
    ("levels", "severities"),
    [(Levels(0.375), [NORMAL, DEGRADED, DEGRADED]), (Levels(), [NOTHING, NOTHING, NOTHING])],
)
def test_a_limit_that_is_absent_is_never_passed(levels: Levels, severities: list[int]) -> None:
    low, high = np.array([0.2, 0.5, 9.0]), np.array([0.3, 0.6, 9.9])
    assert shown_by(low, high, *bounds(levels)).tolist() == severities


def test_intervals_are_as_wide_as_the_false_alarm_rate_asks() -> None:
    """Of 36,000 windows of 10 s in 100 h, as many may lie beyond the interval as alarms are allowed."""
    estimates = Estimates(np.zeros(2), np.array([0.1, 0.1]), np.array([9.0, 45.0]))
    for alarms in (0.1, 1.0, 10.0):
        half = half_width(estimates, tail=tail_of(alarms))
        beyond = stats.t.sf(half / 0.1, df=[9.0, 45.0])
        assert beyond * 36_000 == pytest.approx([alarms, alarms], rel=1e-6)


def test_the_first_condition_counts_from_the_first_window() -> None:
    decision, changes = follow([EMERGENCY] * CONFIRM_WINDOWS)
    assert changes == [("emergency", 0.0, CONFIRM_WINDOWS + 9.0)]
    assert decision.since_s == 0.0


def test_a_change_counts_from_the_middle_of_the_window_that_showed_it() -> None:
    _, changes = follow([NORMAL] * 20 + [DEGRADED] * 10 + [EMERGENCY] * 10)
    assert [change[:2] for change in changes] == [("normal", 0.0), ("degraded", 25.0), ("emergency", 35.0)]


def test_sure_windows_count_only_in_a_row() -> None:
    """One that is less sure between them leaves the change to those that last: two windows' worth."""
    for sure, windows in (([True, True, True, True, False], LASTING_WINDOWS), ([True], CONFIRM_WINDOWS)):
        decision = Decision(LEVELS)
        shown = [decision.feed(DEGRADED, k, k + 10.0, sure=sure[k % len(sure)]) for k in range(60)]
        assert shown.index(True) + 1 == windows
        assert sum(shown) == 1


def test_a_window_that_proves_a_fault_begins_it_at_once_and_at_its_start() -> None:
    """To end it takes as many as ever; where no window proves one, all changes do."""
    n = CONFIRM_WINDOWS
    proven = [
        (0, "degraded", 0.0),
        (n, "normal", 15.0),
        (n + 1, "degraded", 10.0 * (n + 1)),
        (n + 2, "emergency", 10.0 * (n + 2)),
    ]
    for proves, expected in ((True, proven), (False, [(n, "normal", 10.0)])):
        decision = Decision(LEVELS, proven=proves)
        changes = [
            (k, decision.condition, decision.since_s)
            for k, severity in enumerate([DEGRADED, *[NORMAL] * n, DEGRADED, EMERGENCY])
            if decision.feed(severity, 10.0 * k, 10.0 * k + 10.0)
        ]
        assert changes == expected


@given(st.lists(st.integers(1, CONFIRM_WINDOWS - 1), max_size=10))
def test_fewer_windows_than_confirm_change_nothing(runs: list[int]) -> None:
    shown = [NORMAL] * CONFIRM_WINDOWS
    for run in runs:
        shown += [DEGRADED] * run + [NORMAL]
    decision, changes = follow(shown)
    assert len(changes) == 1
    assert decision.condition == "normal"


@given(st.lists(st.sampled_from([NORMAL, DEGRADED, EMERGENCY]), max_size=40), st.data())
def test_windows_that_show_nothing_change_nothing(shown: list[int], data: st.DataObject) -> None:
    decision, changes = follow(shown)
    padded: list[int] = []
    for severity in shown:
        padded += [NOTHING] * data.draw(st.integers(0, 2)) + [severity]
    held, held_changes = follow(padded)
    assert held.condition == decision.condition
    assert [change[0] for change in held_changes] == [change[0] for change in changes]


@pytest.mark.parametrize(
    ("windows", "flight", "after"),
    [
        (NOTHING, NORMAL, "normal"),
        (NOTHING, EMERGENCY, "emergency"),
        (NORMAL, DEGRADED, "degraded"),
        (NORMAL, NORMAL, None),
        (DEGRADED, NORMAL, None),
        (DEGRADED, EMERGENCY, None),
        (NORMAL, NOTHING, None),
    ],
)
def test_the_whole_flight_may_add_a_fault_and_never_ends_one(
    windows: int, flight: int, after: Condition | None
) -> None:
    decision, _ = follow([windows] * 30)
    before = decision.condition, decision.since_s
    assert decision.settle(flight, 3.0) == (after is not None)
    assert (decision.condition, decision.since_s) == ((after, 3.0) if after else before)
