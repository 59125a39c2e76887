"""A weak supply of a servo without a data sheet, against the servo's own flights."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.core.quantities import column
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations.own_scale import TRACKING
from mavhums.health.estimation.flight_sums import OwnSums
from mavhums.health.self_baseline.comparison import compare
from mavhums.results.verdict import OwnRecord
from mavhums_sim.conditions import Condition
from tests.health.flown import flown
from tests.health.self_baseline.servo import blank, collected

_ANGLES = [column("V1"), column("V3")]


def left(seed: int, *conditions: Condition) -> OwnRecord:
    """Return what a flight leaves of a servo that measures command and angle."""
    seen = flown(*conditions, cyclogram="gusts", seconds=60.0, seed=seed)["elevator"]
    values = np.full_like(seen.values, np.nan)
    values[:, _ANGLES] = seen.values[:, _ANGLES]
    record = collected(OwnSums(TRACKING, blank()), (seen.time_s, values, np.full(seen.time_s.size, np.nan)))
    assert isinstance(record, OwnRecord)
    return record


@pytest.mark.slow
def test_a_weak_supply_is_changed_against_the_servos_own_flights() -> None:
    """At 20 V of 27 V lost the shaft falls behind now and then, at 24 V all the time."""
    past = [PastRecord((left(7100 + k),), "2026-01-01", True) for k in range(20)]
    assert compare(TRACKING, left(7200), past).condition == "unchanged"
    for lost_v in (20.0, 22.0, 24.0):
        weak = left(7200, Condition.constant("supply_sag", lost_v))
        assert compare(TRACKING, weak, past).condition == "changed"
