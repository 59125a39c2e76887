"""Motors against the same aircraft's earlier flights."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.core.arrays import Array
from mavhums.health.decision.baseline import Baseline
from mavhums.health.motor.monitor import TRIM, Trims
from mavhums.health.verdict.motor import compare_motors
from mavhums.results.verdict import Coverage, Verdict
from mavhums.vehicle.grid import RATE_HZ
from tests.health.builders import verdict
from tests.health.motor.test_monitor import rotors

COLUMNS = rotors("quad x").columns
FLAT = np.zeros(3)


def flight(effort: Array, *, seed: int = 0, lost: int | None = None, share: float = 0.0) -> list[Verdict]:
    """Return the verdicts on a flight of 100 s whose motors carry this effort, one of them weak."""
    rng = np.random.default_rng(seed)
    # The thrusts that give the effort, as the mixer shares it; a weak motor is asked for more.
    thrusts = 0.4 + 0.4 * effort @ np.linalg.pinv(COLUMNS) + rng.normal(0, 0.02, (100 * RATE_HZ, 4))
    if lost is not None:
        thrusts += 0.4 * share * COLUMNS[lost] @ np.linalg.pinv(COLUMNS)
    trims, seen = Trims(COLUMNS), Coverage(moving_fraction=1.0, windows=100, decidable=100)
    trims.add(thrusts, np.ones(len(thrusts), dtype=bool))
    known = [{"actuator": f"motor {k + 1}", "indicators": trims.of_motor(k)} for k in range(4)]
    return [verdict("normal", subject="motor", coverage=seen, **each) for each in known]


def compared(flown: list[Verdict], earlier: list[list[Verdict]]) -> list[Verdict]:
    known: dict[str, dict[str, Baseline]] = {}
    for k, one in enumerate(flown):
        own = known.setdefault(one.actuator, {})
        for n, shown in enumerate(one.indicators):
            baseline = Baseline.of([past[k].indicators[n] for past in earlier])
            if baseline is not None:
                own[shown.fault] = baseline
    start = datetime(2026, 1, 1, tzinfo=UTC)
    return compare_motors(flown, lambda one: known[one.actuator], start_utc=start, end_s=100.0)


def earlier(flights: int = 4) -> list[list[Verdict]]:
    rng = np.random.default_rng(7)
    return [flight(rng.normal(0, [0.02, 0.04, 0.01]), seed=k) for k in range(flights)]


@pytest.mark.parametrize("motor", range(4))
def test_a_worn_propeller_is_found_by_its_motor(motor: int) -> None:
    verdicts = compared(flight(FLAT, lost=motor, share=0.3), earlier())
    assert [one.condition == "degraded" for one in verdicts] == [k == motor for k in range(4)]
    [evidence] = verdicts[motor].evidence
    assert "4 earlier flights" in evidence.rule
    assert evidence.value == pytest.approx(0.3, abs=0.08)
    assert "weight" not in evidence.rule, "a weight does not move the effort about yaw"


def test_what_whole_propellers_show_is_no_finding() -> None:
    past = earlier(8)
    for seed in range(20):
        effort = np.random.default_rng([seed, 1]).normal(0, [0.026, 0.048, 0.012])
        assert {v.condition for v in compared(flight(effort, seed=seed), past)} == {"normal"}
    assert {v.condition for v in compared(flight(FLAT, lost=0, share=0.3), earlier(2))} == {"normal"}


@given(st.lists(st.integers(1, 99), max_size=5))
def test_the_trim_does_not_depend_on_how_the_log_is_cut(cuts: list[int]) -> None:
    rng = np.random.default_rng(3)
    thrusts = rng.uniform(0.2, 0.6, (100 * RATE_HZ, 4))
    flown = rng.random(len(thrusts)) > 0.01
    whole, parts = Trims(COLUMNS), Trims(COLUMNS)
    whole.add(thrusts, flown)
    for a, b in zip([0, *sorted(cuts)], [*sorted(cuts), 100], strict=True):
        parts.add(thrusts[a * RATE_HZ : b * RATE_HZ], flown[a * RATE_HZ : b * RATE_HZ])
    assert parts.of_motor(2) == whole.of_motor(2)
    assert whole.of_motor(2)[0].fault == TRIM
