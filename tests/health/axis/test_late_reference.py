"""A reference that comes after two minutes of forward flight: what it says, and what it must not."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.axis.past import compare_with_earlier_flights
from mavhums.health.decision.baseline import Baseline
from mavhums.health.verdict.axis import indicators
from mavhums.vehicle.rows import Rows
from tests.health.axis.flights import changes_of, excited, late, rows, steady
from tests.health.builders import verdict
from tests.present import present

QUIET_S = 220
START = datetime(2026, 5, 1, tzinfo=UTC)


def flown(seconds: int, *, left: float = 1.0, from_s: int = 0, astray: tuple[int, int] | None = None) -> Rows:
    """Ailerons that do not move for 220 s; ``left`` of their effect from a second on; a bank ``astray``."""
    made = steady(seconds)
    n = len(made["speed"])
    still = np.arange(n) < QUIET_S * 20
    demand = np.where(still, 0.0, excited(seconds))
    gain = np.where(np.arange(n) < from_s * 20, 2.2, 2.2 * left)
    noise = 0.03 * np.random.default_rng(7).normal(size=n)
    made["outputs"][:, 0] = demand
    made["roll_rate"] = gain * late(demand) + noise
    # The angles come from a slow stream of their own: only their distance from the command is looked at.
    made["roll"] = 0.01 * np.random.default_rng(8).normal(size=n)
    if astray is not None:
        made["roll"][astray[0] * 20 : astray[1] * 20] += np.radians(40.0)
    return rows(made)


def test_a_late_reference_judges_what_follows_and_says_from_when_on() -> None:
    monitor = AxisMonitor(1)
    changes = changes_of(monitor, flown(600, left=0.4, from_s=420))
    found = monitor.findings("roll")
    assert next(c.after for c in changes if c.actuator == "roll") == "unchanged"
    assert found.condition in ("degraded", "emergency")
    assert found.since_s == pytest.approx(420, abs=15)
    assert found.coverage.judged_from_s == present(found.reference).end_s > QUIET_S


def test_an_early_reference_says_nothing_of_the_kind() -> None:
    made = flown(QUIET_S + 160).cut(QUIET_S, QUIET_S + 160)
    monitor = AxisMonitor(1)
    list(monitor.feed(made))
    assert monitor.findings("roll").condition == "unchanged"
    assert monitor.findings("roll").coverage.judged_from_s is None


@pytest.mark.slow
@pytest.mark.parametrize("block", [7, 600])
def test_a_reference_taken_during_a_fault_does_not_end_it(block: int) -> None:
    flight, monitor = flown(600, astray=(180, 200)), AxisMonitor(1)
    for begin in range(0, 600, block):
        list(monitor.feed(flight.cut(begin, min(begin + block, 600))))
    found = monitor.findings("roll")
    assert found.reference is not None
    assert found.condition == "emergency"
    assert found.effectiveness is None
    assert found.coverage.decidable == 0


@pytest.mark.slow
def test_a_finding_against_earlier_flights_holds_from_a_late_reference_on() -> None:
    monitor = AxisMonitor(1)
    list(monitor.feed(flown(600, left=0.4)))
    found = monitor.findings("roll")
    shown = {"coverage": found.coverage, "indicators": tuple(indicators(found))}
    alone = verdict(found.condition, subject="axis", effectiveness=found.effectiveness, **shown)
    assert alone.condition == alone.worst == found.worst == "unchanged"
    past = Baseline(mean=2.2 / 18.0, error=0.001, flights=6, between=0.004, spread=0.004)
    compared = compare_with_earlier_flights(alone, {"effectiveness": past}, start_utc=START, end_s=600.0)
    assert compared.condition == "emergency"
    assert present(compared.since).flight_time_s == alone.coverage.judged_from_s
    assert compared.evidence[0].rule.endswith(f"is left, from {alone.coverage.judged_from_s:.0f} s on")
