"""The sequential decision."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.actuator.profile import Limits
from mavhums.assessment import Interval
from mavhums.health.decision import CONFIRM, Change, Decision, classify, rule

LIMITS = Limits(normal=0.375, emergency=0.875)
NORMAL = Interval(estimate=0.3, low=0.28, high=0.32)
DEGRADED = Interval(estimate=0.5, low=0.48, high=0.52)
EMERGENCY = Interval(estimate=1.0, low=0.98, high=1.02)


def follow(windows: Sequence[Interval | None]) -> tuple[Decision, list[Change]]:
    decision = Decision(LIMITS)
    changes = [decision.feed(window, float(k), float(k + 10)) for k, window in enumerate(windows)]
    return decision, [change for change in changes if change]


@pytest.mark.parametrize(
    ("low", "high", "condition"),
    [
        (0.2, 0.3, "normal"),
        (0.37, 0.5, "normal"),
        (0.375, 0.5, "normal"),
        (0.38, 0.87, "degraded"),
        (0.38, 0.875, "emergency"),
        (0.3, 0.9, "normal"),
        (0.9, 1.1, "emergency"),
    ],
)
def test_the_rule_of_the_interval(low: float, high: float, condition: str) -> None:
    interval = Interval(estimate=(low + high) / 2, low=low, high=high)
    assert classify(interval, LIMITS) == condition


def test_the_first_condition_counts_from_the_first_window() -> None:
    decision, changes = follow([EMERGENCY] * CONFIRM)
    assert changes == [Change("undecided", "emergency", 0.0, CONFIRM + 9.0)]
    assert decision.worst == "emergency"


def test_a_change_counts_from_the_middle_of_the_window_that_showed_it() -> None:
    decision, changes = follow([NORMAL] * 20 + [DEGRADED] * 10 + [EMERGENCY] * 10)
    assert [(change.after, change.since_s) for change in changes] == [
        ("normal", 0.0),
        ("degraded", 25.0),
        ("emergency", 35.0),
    ]
    assert decision.condition == decision.worst == "emergency"


def test_the_worst_is_remembered() -> None:
    decision, _ = follow([EMERGENCY] * 10 + [NORMAL] * 10)
    assert (decision.condition, decision.worst) == ("normal", "emergency")


@given(st.lists(st.integers(1, CONFIRM - 1), max_size=10))
def test_fewer_windows_than_confirm_change_nothing(runs: list[int]) -> None:
    windows: list[Interval | None] = [NORMAL] * CONFIRM
    for run in runs:
        windows += [DEGRADED] * run + [NORMAL]
    decision, changes = follow(windows)
    assert len(changes) == 1
    assert decision.condition == "normal"


@given(st.lists(st.sampled_from([NORMAL, DEGRADED, EMERGENCY]), max_size=40), st.data())
def test_undecidable_windows_change_nothing(windows: list[Interval | None], data: st.DataObject) -> None:
    decision, changes = follow(windows)
    padded: list[Interval | None] = []
    for window in windows:
        padded += [None] * data.draw(st.integers(0, 2)) + [window]
    held, held_changes = follow(padded)
    assert held.condition == decision.condition
    assert [change.after for change in held_changes] == [change.after for change in changes]


def test_rules_name_the_limit() -> None:
    assert "0.875" in rule("emergency", LIMITS)
    assert "0.375" in rule("degraded", LIMITS)
    assert "0.375" in rule("normal", LIMITS)
    assert rule("undecided", LIMITS)
