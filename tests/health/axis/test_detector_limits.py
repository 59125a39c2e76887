"""The limits of each detector of an axis, with seconds made by hand."""

from __future__ import annotations

from dataclasses import replace
from math import exp
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
from mavhums.health.axis.reference import Second
from mavhums.health.axis.residuals import Deviation
from mavhums.health.axis.thresholds import (
    DOUBTFUL_S,
    DOUBTFUL_TIMES,
    EMERGENCY_S,
    PERSISTENT_S,
    SHIFT_FLOOR_RAD_S,
    SHIFT_S,
    SKID_ALONE_DEVIATIONS,
    SKID_DEVIATIONS,
    SKID_M_S2,
    SKID_S,
    SKID_SHARE,
    SKIDDING_DEVIATIONS,
    TRIM_SHIFT_DEVIATIONS,
)
from mavhums.results.sections import AxisLimits

LIMITS = AxisLimits()
CERTAIN, COMMON = 10.0, 0.5
SURE = CERTAIN * 1.001
DOUBTED = CERTAIN * DOUBTFUL_TIMES
DEVIATION = 2.0 * SHIFT_FLOOR_RAD_S  # of the reference


def second(**changes: Any) -> Second:
    """Return a second with a certain loss, but for the changes."""
    whole = Second(100, 0.5, 0.05, SURE, 80, None, False, 0.0, COMMON, 0.05, EMERGENCY_S, 0)
    return replace(whole, **changes)


def given(
    *seconds: Second, axis: str = "roll", deviation: float | None = DEVIATION, sides: tuple[Any, ...] = ()
) -> AxisInput:
    reference = None if deviation is None else SimpleNamespace(deviation=deviation)
    trackers: Any = {axis: SimpleNamespace(reference=reference)}
    rows: Any = None
    return AxisInput(rows, {axis: seconds}, trackers, {side.end_s: side for side in sides})


def alarms(one: Second, axis: str = "roll", deviation: float | None = DEVIATION) -> list[Alarm]:
    detector = EffectivenessDetector(LIMITS, axis, CERTAIN, COMMON)
    return detector.feed(given(one, axis=axis, deviation=deviation))


@pytest.mark.parametrize(
    ("changes", "certain"),
    [
        ({}, True),
        ({"level": CERTAIN}, False),
        ({"lost_s": DOUBTFUL_S}, True),
        ({"lost_s": DOUBTFUL_S - 1}, False),
        ({"lost_s": DOUBTFUL_S - 1, "level": DOUBTED}, False),
        ({"lost_s": DOUBTFUL_S - 1, "level": 1.001 * DOUBTED}, True),
        ({"left_over": COMMON + 0.01}, False),
        ({"left_over": COMMON + 0.01, "later": True}, True),
        ({"left_over": COMMON + 0.01, "level": 1.001 * DOUBTED}, True),
        ({"left_over": None}, False),
        ({"slow_s": LIMITS.lag_s}, True),
        ({"slow_s": LIMITS.lag_s - 0.01}, False),
    ],
)
def test_a_loss_is_certain(changes: dict[str, Any], certain: bool) -> None:
    assert bool(alarms(second(**changes))) is certain
    assert not alarms(second(**changes), deviation=None)


@pytest.mark.parametrize(
    ("shift", "lost_s", "deviation", "axis", "certain"),
    [
        (TRIM_SHIFT_DEVIATIONS * DEVIATION, DOUBTFUL_S - 1, DEVIATION, "roll", True),
        (-1.01 * TRIM_SHIFT_DEVIATIONS * DEVIATION, DOUBTFUL_S - 1, DEVIATION, "roll", False),
        (1.01 * TRIM_SHIFT_DEVIATIONS * DEVIATION, DOUBTFUL_S - 1, DEVIATION, "steering", False),
        (1.01 * TRIM_SHIFT_DEVIATIONS * DEVIATION, DOUBTFUL_S - 1, DEVIATION, "pitch", True),
        (1.01 * TRIM_SHIFT_DEVIATIONS * DEVIATION, DOUBTFUL_S, DEVIATION, "roll", True),
        (0.99 * TRIM_SHIFT_DEVIATIONS * SHIFT_FLOOR_RAD_S, DOUBTFUL_S - 1, 0.001, "roll", True),
        (1.01 * TRIM_SHIFT_DEVIATIONS * SHIFT_FLOOR_RAD_S, DOUBTFUL_S - 1, 0.001, "roll", False),
        (None, DOUBTFUL_S - 1, DEVIATION, "roll", True),
    ],
)
def test_a_sudden_shift_of_the_trim_is_no_loss_for_some_seconds(
    shift: float | None, lost_s: int, deviation: float, axis: str, certain: bool
) -> None:
    one = second(shift=shift, lost_s=lost_s, level=1.001 * DOUBTED)
    assert bool(alarms(one, axis, deviation)) is certain


@pytest.mark.parametrize(
    ("changes", "condition", "limit", "rule"),
    [
        ({"left_over": LIMITS.effectiveness_emergency}, "emergency", LIMITS.effectiveness_emergency, "left"),
        (
            {"left_over": LIMITS.effectiveness_emergency + 0.01},
            "degraded",
            LIMITS.effectiveness_degraded,
            "left",
        ),
        ({"left_over": None}, "degraded", LIMITS.effectiveness_degraded, "100 % of the control effective"),
        ({"left_over": -0.1}, "emergency", LIMITS.effectiveness_emergency, "emergency: 0 % of the control"),
        ({"later": True}, "degraded", LIMITS.effectiveness_degraded, "left; a slow servo explains it nearly"),
        (
            {"lost_s": EMERGENCY_S - 1},
            "degraded",
            LIMITS.effectiveness_degraded,
            f"left; an emergency if {EMERGENCY_S} judged seconds show it, {EMERGENCY_S - 1} do",
        ),
    ],
)
def test_a_certain_loss_is_an_emergency_where_nothing_else_explains_it(
    changes: dict[str, Any], condition: str, limit: float, rule: str
) -> None:
    one = second(level=3.0 * CERTAIN, **changes)
    [found] = alarms(one)
    assert (found.fault, found.condition, found.limit) == ("effectiveness", condition, limit)
    assert found.rule.startswith(f"{condition}: ")
    assert rule in found.rule
    assert found.value == (1.0 if one.left_over is None else one.left_over)
    assert (found.end_s, found.since_s) == (100, 80)
    assert found.confidence == pytest.approx(1.0 / (1.0 + exp(-3.0 * CERTAIN)))


def test_a_lag_is_degraded_whatever_is_left() -> None:
    [found] = alarms(second(slow_s=0.5, left_over=0.1))
    assert (found.fault, found.condition, found.value, found.limit) == ("slow", "degraded", 0.5, LIMITS.lag_s)


def deflected(
    deviations: float, side: Deviation | None = None, axis: str = "roll", limit: float = 5.0
) -> list[Alarm]:
    """Return the alarms of a roll rate that is away by so many deviations for as long as it must."""
    detector = HardOverDetector(AxisLimits(trim_deviations=limit), axis)
    seconds = [second(end_s=100 + k, shift=deviations * DEVIATION) for k in range(PERSISTENT_S)]
    sides = () if side is None else (side._replace(end_s=seconds[-1].end_s),)
    return detector.feed(given(*seconds, axis=axis, sides=sides))


def test_the_error_of_the_gain_makes_no_skid_of_an_aileron() -> None:
    """It lessens how certain the shift is, not how far the roll goes astray beside the side force."""
    detector = HardOverDetector(AxisLimits(trim_deviations=5.0), "roll")
    shift = 1.1 * SKID_DEVIATIONS * DEVIATION
    seconds = [second(end_s=100 + k, shift=shift, shift_error=0.6 * DEVIATION) for k in range(PERSISTENT_S)]
    side = Deviation(seconds[-1].end_s, 2.0, 1.05 * SKID_DEVIATIONS)
    [found] = detector.feed(given(*seconds, sides=(side,)))
    assert found.axis == "roll"


@pytest.mark.parametrize(
    ("deviations", "side", "value", "axis"),
    [
        (5.5, SKID_DEVIATIONS, 2.0, "roll"),
        (5.5, SKID_DEVIATIONS + 0.01, 2.0, "yaw"),
        (5.5, SKID_DEVIATIONS + 0.01, -2.0, "yaw"),
        (5.5, SKID_DEVIATIONS + 0.01, SKID_M_S2, "roll"),
        (5.5, SKID_DEVIATIONS + 0.01, -SKID_M_S2 - 0.01, "yaw"),
        (8.0, 7.9, 2.0, "roll"),
        (8.0, 8.1, 2.0, "yaw"),
    ],
)
def test_a_larger_skid_beside_a_roll_is_a_rudder(
    deviations: float, side: float, value: float, axis: str
) -> None:
    [found] = deflected(deviations, Deviation(0, value, side))
    what = "a rudder" if axis == "yaw" else "an aileron or elevon"
    assert (found.axis, found.fault, found.since_s) == (axis, "hard_over", 99)
    assert f"as if {what} stood deflected" in found.rule
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
        (None, SKID_ALONE_DEVIATIONS, 2.0, False),
        (None, SKID_ALONE_DEVIATIONS + 0.01, 2.0, True),
        (1.0, SKIDDING_DEVIATIONS, 2.0, False),
        (1.0, SKIDDING_DEVIATIONS + 0.01, 2.0, True),
        (1.0, SKIDDING_DEVIATIONS + 0.01, -2.0, True),
        (1.0, SKIDDING_DEVIATIONS + 0.01, -SKID_M_S2, False),
        (20.0, 20.0 * SKID_SHARE - 0.01, 2.0, False),
        (20.0, 20.0 * SKID_SHARE + 0.01, 2.0, True),
    ],
)
def test_a_skid_that_lasts_is_larger_than_the_roll_explains(
    roll: float | None, side: float, value: float, found: bool
) -> None:
    shift = None if roll is None else roll * DEVIATION
    seconds = [second(end_s=100 + k, shift=shift) for k in range(SKID_S)]
    sides = tuple(Deviation(one.end_s, value, side) for one in seconds)
    shown = Skids().feed(given(*seconds, sides=sides))
    assert bool(shown) is found
    assert not Skids().feed(given(*seconds, sides=sides[1:]))
    for alarm in shown:
        assert (alarm.axis, alarm.since_s) == ("yaw", 99 - (SHIFT_S - 1))
        assert f"2.0 m/s² to the {'right' if value > 0 else 'left'}" in alarm.rule
