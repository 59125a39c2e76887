"""The limits of each detector of an axis, with seconds made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from mavhums.health.axis.detectors import AxisInput, EffectivenessDetector, Skids
from mavhums.health.axis.reference import Loss, Second
from mavhums.health.axis.residuals import Deviation
from mavhums.results.sections import AxisLimits

LIMITS = AxisLimits()
DEVIATION = 0.09  # of the reference, rad/s


def second(**changes: Any) -> Second:
    """Return a second without a loss, but for the changes."""
    whole = Second(100, 0.5, 0.05, None, 0.0, 0.0, 0)
    return replace(whole, **changes)


def given(
    *seconds: Second, axis: str = "roll", deviation: float | None = DEVIATION, sides: tuple[Any, ...] = ()
) -> AxisInput:
    reference = None if deviation is None else SimpleNamespace(deviation=deviation)
    trackers: Any = {axis: SimpleNamespace(reference=reference)}
    rows: Any = None
    return AxisInput(rows, {axis: seconds}, trackers, {side.end_s: side for side in sides})


@pytest.mark.parametrize(
    ("changes", "fault", "condition"),
    [
        ({"kept": LIMITS.effectiveness_emergency}, "effectiveness", "emergency"),
        ({"kept": LIMITS.effectiveness_emergency + 0.01}, "effectiveness", "degraded"),
        ({"kept": -0.1}, "effectiveness", "emergency"),
        ({"kept": 0.4, "grave": 0.94}, "effectiveness", "degraded"),
        ({"lag_s": 0.5, "kept": 0.1}, "slow", "degraded"),
        ({"certain": False}, None, None),
    ],
)
def test_a_certain_loss_is_an_emergency_where_no_lag_explains_it(
    changes: dict[str, Any], fault: str | None, condition: str | None
) -> None:
    loss = Loss(True, 80, 14.0, None, 0.5, 0.05, 1.0)._replace(**changes)
    alarms = EffectivenessDetector(LIMITS, "roll").feed(given(second(loss=loss)))
    assert [(alarm.fault, alarm.condition) for alarm in alarms] == ([(fault, condition)] if fault else [])
    for alarm in alarms:
        assert alarm.rule.startswith(f"{condition}: ")
        assert (alarm.end_s, alarm.since_s) == (100, 80)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("roll", "side"), [(10.0, 8.0), (3.0, 5.0), (13.0, 3.2), (2.0, 9.0), (None, 31.0), (None, 12.0)]
)
def test_a_rudder_is_certain_where_it_makes_the_skid_twenty_times_likelier_than_an_aileron(
    roll: float | None, side: float, way: float
) -> None:
    """The skid of an aileron has a tenth of the roll, that of a rudder a half, beside two deviations."""
    shift = None if roll is None else roll * DEVIATION
    seconds = [second(end_s=100 + k, shift=shift) for k in range(40)]
    sides = tuple(Deviation(one.end_s, 2.0 * way, side) for one in seconds)
    shown = Skids().feed(given(*seconds, sides=sides))
    rudder, aileron = (norm(0.0, np.hypot(2.0, share * (roll or 40.0))) for share in (0.5, 0.1))
    each = float(rudder.logpdf(side) - aileron.logpdf(side)) / 3.0
    expected = [k for k in range(40) if (k + 1) * each >= np.log(20.0)] if each > 0.0 else []
    assert [alarm.end_s - 100 for alarm in shown] == expected
    for alarm in shown:
        assert (alarm.axis, alarm.since_s) == ("yaw", 97)
        assert f"2.0 m/s² to the {'right' if way > 0 else 'left'}" in alarm.rule


def test_evidence_of_a_rudder_ends_where_the_side_force_is_not_known() -> None:
    seconds = [second(end_s=100 + k, shift=10.0 * DEVIATION) for k in range(4)]
    known = [Deviation(one.end_s, 2.0, 8.0) for one in seconds]
    assert Skids().feed(given(*seconds, sides=tuple(known)))
    known[1] = Deviation(101, np.nan, np.nan)
    assert not Skids().feed(given(*seconds, sides=tuple(known)))


def test_a_roll_beyond_the_regression_is_no_less_than_before() -> None:
    """A side force of 10 deviations is a rudder's beside an unknown roll of 40, an aileron's beside 100."""
    for before, found in ((1.0, True), (100.0, False)):
        known = [second(end_s=100 + k, shift=before * DEVIATION) for k in range(3)]
        unknown = [second(end_s=103 + k, shift=None) for k in range(20)]
        sides = [Deviation(one.end_s, 2.0, 1.0) for one in known]
        sides += [Deviation(one.end_s, 2.0, 12.0) for one in unknown]
        assert bool(Skids().feed(given(*known, *unknown, sides=tuple(sides)))) is found
