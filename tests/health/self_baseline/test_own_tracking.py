"""Servos that measure only command and angle, against their own flights: a weak supply."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.core.quantities import KEYS
from mavhums.health.estimation.equations.own_scale import TRACKING
from mavhums.health.estimation.flight_sums import OwnSums
from mavhums.health.self_baseline.comparison import compare
from mavhums.results.verdict import OwnRecord
from mavhums_sim.conditions import Condition
from tests.health.flown import flown
from tests.health.self_baseline.servo import blank, collected, past
from tests.present import present


def left(seed: int, *conditions: Condition) -> OwnRecord:
    """Return what a flight leaves of a servo that measures command and angle."""
    seen = flown(*conditions, cyclogram="gusts", seconds=60.0, seed=seed)["elevator"]
    values = np.where(np.isin(KEYS, ["V1", "V3"]), seen.values, np.nan)
    return present(collected(OwnSums(TRACKING, blank()), (seen.time_s, values, None)))


@pytest.mark.slow
def test_a_weak_supply_is_changed_against_the_servos_own_flights() -> None:
    """At 20 V of 27 V lost the shaft falls behind now and then, at 24 V all the time."""
    before = past(*(left(7100 + k) for k in range(20)))
    assert compare(TRACKING, left(7200), before).condition == "unchanged"
    for lost_v in (20.0, 22.0, 24.0):
        weak = left(7200, Condition.constant("supply_sag", lost_v))
        assert compare(TRACKING, weak, before).condition == "changed"
