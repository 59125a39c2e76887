"""What an axis is known by: the seconds that count, and when it is well."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mavhums.core.conditions import Condition
from mavhums.health.axis.monitor import AxisMonitor, _AxisState
from mavhums.health.axis.thresholds import FULL_S, JUDGED_ERROR, NORMAL_EFFECTIVENESS, NORMAL_S
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.standing import Interval


def interval(low: float) -> Interval:
    return Interval(estimate=low + 0.1, low=low, high=low + 0.2)


def test_windows_that_share_seconds_are_one_piece_of_evidence() -> None:
    """The first second counts, and each tenth: the mean of those that are known well enough."""
    monitor, state = AxisMonitor(1), _AxisState()
    used = []
    for k in range(1, 36):
        known = k not in (4, 17)
        error = (1.0 if known else 1.01) * JUDGED_ERROR
        second: Any = SimpleNamespace(end_s=k, value=k / 10, error=error, driven=None, excluded=k in (3, 7))
        monitor._count(state, second)
        used += [k / 10] * known
    judged = [used[0], *(used[k - 1] for k in range(int(WINDOW_S), len(used) + 1, int(WINDOW_S)))]
    assert (state.seconds, state.judged, state.mean.count) == (35, 33, len(judged))
    assert state.value is not None
    assert state.value.estimate == pytest.approx(np.mean(judged))
    assert (state.excluded_s, state.excluded_until_s) == (2, 7.0)
    assert state.full == sum(value >= monitor.limits.effectiveness_degraded for value in used)


@pytest.mark.parametrize(
    ("condition", "judged", "full", "low", "doubted", "well"),
    [
        ("undecided", NORMAL_S, 0, NORMAL_EFFECTIVENESS + 0.001, False, True),
        ("undecided", NORMAL_S - 1, 99, NORMAL_EFFECTIVENESS + 0.001, False, False),
        ("undecided", NORMAL_S, 99, NORMAL_EFFECTIVENESS, False, False),
        ("undecided", NORMAL_S, 99, None, False, False),
        ("normal", NORMAL_S, 99, 0.9, True, False),
        ("degraded", 0, FULL_S, None, True, True),
        ("degraded", 99, FULL_S - 1, 0.9, False, False),
        ("emergency", 99, FULL_S - 1, 0.9, False, False),
    ],
)
def test_an_axis_is_well_when_its_gain_is_known_to_be_back(
    condition: Condition, judged: int, full: int, low: float | None, doubted: bool, well: bool
) -> None:
    state = _AxisState()
    state.condition, state.judged, state.full = condition, judged, full
    state.value = None if low is None else interval(low)
    state.doubt = interval(0.5) if doubted else None
    assert AxisMonitor(1)._is_healthy(state) == well


@pytest.mark.parametrize(("low", "doubted"), [(0.001, False), (0.0, True), (-0.1, True)])
def test_the_last_minute_is_doubted_where_it_does_not_exclude_a_loss(low: float, doubted: bool) -> None:
    state = _AxisState()
    driven = interval(NORMAL_EFFECTIVENESS + low)
    second: Any = SimpleNamespace(end_s=1, value=None, error=0.0, driven=driven, excluded=False)
    AxisMonitor(1)._count(state, second)
    assert state.doubt == (driven if doubted else None)
