"""The limits of each detector of an axis, with seconds made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from mavhums.health.axis.detectors import (
    Alarm,
    AxisInput,
    EffectivenessDetector,
    HardOverDetector,
    Skids,
)
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


def deflected(
    deviations: float, side: Deviation | None = None, axis: str = "roll", limit: float = 5.0
) -> list[Alarm]:
    """Return the alarms of a roll rate that is away by so many deviations for as long as it must."""
    detector = HardOverDetector(AxisLimits(trim_deviations=limit), axis)
    seconds = [second(end_s=100 + k, shift=deviations * DEVIATION) for k in range(2)]
    sides = () if side is None else (side._replace(end_s=seconds[-1].end_s),)
    return detector.feed(given(*seconds, axis=axis, sides=sides))


def test_the_error_of_the_gain_makes_no_skid_of_an_aileron() -> None:
    """It lessens how certain the shift is, not how far the roll goes astray beside the side force."""
    detector = HardOverDetector(AxisLimits(trim_deviations=5.0), "roll")
    shift = 6.6 * DEVIATION
    seconds = [second(end_s=100 + k, shift=shift, shift_error=0.6 * DEVIATION) for k in range(2)]
    side = Deviation(seconds[-1].end_s, 2.0, 6.3)
    [found] = detector.feed(given(*seconds, sides=(side,)))
    assert found.axis == "roll"


@pytest.mark.parametrize(
    ("deviations", "side", "value", "axis"),
    [
        (8.0, 7.9, 2.0, "roll"),
        (8.0, 8.1, 2.0, "yaw"),
        (8.0, 8.1, -2.0, "yaw"),
        (8.0, 8.1, 1.0, "roll"),
        (8.0, 8.1, -1.01, "yaw"),
    ],
)
def test_a_larger_skid_beside_a_roll_is_a_rudder(
    deviations: float, side: float, value: float, axis: str
) -> None:
    [found] = deflected(deviations, Deviation(0, value, side))
    what = "a rudder" if axis == "yaw" else "an aileron or elevon"
    assert (found.axis, found.fault, found.since_s) == (axis, "hard_over", 99)
    assert f"as if {what} stayed deflected" in found.rule
    assert found.value == pytest.approx(deviations)


def test_a_hard_over_surface_says_which_way() -> None:
    assert not deflected(5.0)
    for sign, way in ((1.0, "right"), (-1.0, "left")):
        [rolls], [turns] = deflected(sign * 6.0), deflected(sign * 6.0, axis="steering")
        assert rolls.rule.startswith(f"emergency: rolls {way} 31°/s more than commanded, as if an aileron")
        assert turns.rule.startswith(f"emergency: turns {way} 31°/s more than commanded, as if its steering")


@pytest.mark.parametrize(
    ("roll", "side", "value", "found"),
    [
        (None, 12.0, 2.0, False),
        (None, 12.01, 2.0, True),
        (1.0, 3.5, 2.0, False),
        (1.0, 3.51, 2.0, True),
        (1.0, 3.51, -2.0, True),
        (1.0, 3.51, -1.0, False),
        (20.0, 5.99, 2.0, False),
        (20.0, 6.01, 2.0, True),
    ],
)
def test_a_skid_that_lasts_is_larger_than_the_roll_explains(
    roll: float | None, side: float, value: float, found: bool
) -> None:
    shift = None if roll is None else roll * DEVIATION
    seconds = [second(end_s=100 + k, shift=shift) for k in range(4)]
    sides = tuple(Deviation(one.end_s, value, side) for one in seconds)
    shown = Skids().feed(given(*seconds, sides=sides))
    assert bool(shown) is found
    assert not Skids().feed(given(*seconds, sides=sides[1:]))
    for alarm in shown:
        assert (alarm.axis, alarm.since_s) == ("yaw", 97)
        assert f"2.0 m/s² to the {'right' if value > 0 else 'left'}" in alarm.rule
