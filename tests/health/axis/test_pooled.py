"""Effectiveness pooled over a minute: what a quiet flight excludes, and when a flight is no longer normal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mavhums.health.axis.evidence import LossTest
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.axis.reference import Reference, measured
from mavhums.health.axis.regressions import Basis, Shape
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Coverage
from tests.health.axis.flights import Array, changes_of, excited, late, rolling, rows, steady
from tests.present import present

GAIN = 2.0
REFERENCE = Reference(
    Basis(18.0, 0.0), Shape(0, 0.0), GAIN, np.zeros(1), 0.01, 0.03, 0.9, 0.1, np.zeros((2, 2)), 0, 45
)  # fmt: skip


def coverage(flight: dict[str, Array]) -> Coverage:
    monitor = AxisMonitor(1)
    list(monitor.feed(rows(flight)))
    return monitor.findings("roll").coverage


@given(arrays(float, (20, 2), elements=st.floats(0.01, 4.0)), st.integers(2, 20))
def test_pooled_seconds_are_a_regression_through_the_origin(sums: Array, n: int) -> None:
    drive2, cross = sums.T
    values, errors = measured(drive2, cross, REFERENCE)
    gain = cross[:n].sum() / drive2[:n].sum()
    scatter = ((cross[:n] - gain * drive2[:n]) ** 2).sum() * n / (n - 1) / drive2[:n].sum()
    own = max(scatter, REFERENCE.variance) / drive2[:n].sum() / GAIN**2
    spread = 0.1**2 * min(10 / n, 1.0)
    assert values[n - 1] == pytest.approx(gain / GAIN)
    assert errors[n - 1] ** 2 == pytest.approx(own + (gain / GAIN * REFERENCE.error) ** 2 + spread)
    assert np.isinf(errors[0])


def test_each_second_is_excluded_once() -> None:
    """A second of (K·d)² = 0.04 in a noise of 0.01 makes a loss of 40 % 0.32 less likely, as a logarithm.

    A standard error of the reference's gain of 3 % hardly changes that.
    """
    test = LossTest(REFERENCE, AxisLimits())
    assert test.excludes_in_reference([(0.01, 0.01 * GAIN, 0.0)] * 45) == 45
    # The seconds of the reference do not speak for those after it.
    excluded = [test.excludes(0.01, 0.01 * GAIN) for _ in range(40)]
    assert excluded == [0] * 9 + [10] + [1] * 30
    assert not any(test.excludes(0.01, 0.5 * 0.01 * GAIN) for _ in range(100))


def test_a_quiet_flight_says_which_loss_it_excludes() -> None:
    """Ten seconds of it show no effectiveness, half a minute excludes a loss of 40 %: the axis is judged."""

    def flight(left: float) -> dict[str, Array]:
        made = steady(240)
        demand = np.concatenate([excited(60), 0.035 * excited(180, seed=3)])
        made["outputs"][:, 0] = demand
        noise = 0.03 * np.random.default_rng(7).normal(size=demand.size)
        gain = np.where(np.arange(demand.size) < 1200, 2.2, 2.2 * left)
        made["roll_rate"] = gain * late(demand) + noise
        return made

    whole, half = coverage(flight(1.0)), coverage(flight(0.45))
    assert whole.excluded > whole.decidable > 150
    assert half.decidable < 60
    assert present(whole.excluded_until_s) > 200
    # A window that holds more of the time before may still exclude it.
    assert half.excluded < 90
    assert present(half.excluded_until_s) < 90


@pytest.mark.parametrize("left", [0.95, 0.7])
def test_no_axis_is_normal_while_a_loss_is_likely(left: float) -> None:
    changes = changes_of(AxisMonitor(1), rolling(130, lambda t: np.where(t < 100, 2.2, 2.2 * left)))
    taken_back = [c for c in changes if (c.before, c.after) == ("unchanged", "undecided")]
    assert bool(taken_back) is (left < 0.8)
    for change in taken_back:
        assert 100 < change.time_s < 125
        assert "is left by the last seconds" in change.rule
