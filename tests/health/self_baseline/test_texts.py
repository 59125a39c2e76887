"""What a comparison with the earlier flights puts into a verdict: texts, numbers, and what stays of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from mavhums.core.conditions import Condition
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.equations.own_scale import CURRENT, RIPPLE, ROUGHNESS, TWO_WAYS
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.least_squares import packed
from mavhums.health.self_baseline import verdict as judged
from mavhums.health.self_baseline.comparison import Comparison
from mavhums.results.verdict import Interval, OwnRecord, Verdict
from tests.health.builders import verdict

RISE = Interval(estimate=0.6, low=0.49, high=0.73)
NEAR = Interval(estimate=0.02, low=-0.06, high=0.1)
VALUE = Interval(estimate=0.123456, low=0.103456, high=0.143456)
USUAL = Interval(estimate=0.0987654, low=0.0876543, high=0.1098765)
NONE = Comparison("undecided", None, 0, 20)
LEARNING = Comparison("learning", VALUE, 6, 10)
STILL = Comparison("undecided", VALUE, 20, 10)
LIKE = Comparison("unchanged", VALUE, 20, 10, USUAL, NEAR, 0.123456)
RISEN = Comparison("changed", VALUE, 20, 10, USUAL, RISE, 0.123456)


def record(name: str, *loads: float) -> OwnRecord:
    """Return what a flight of strokes leaves, or one of the current that shows nothing."""
    still = ((1.0, *packed(np.zeros((len(KEPT), len(KEPT))))),)
    groups = still if name == CURRENT.name else tuple((1.0, 0.3, load) for load in loads)
    return OwnRecord(equation=name, setup="by its angle", rate_hz=25.0, duration_s=60.5, groups=groups)


def compared(
    monkeypatch: pytest.MonkeyPatch, found: Mapping[str, Comparison], before: Verdict | None = None
) -> Verdict:
    """Return the verdict on a flight whose equations compare like this with the flights before it."""
    monkeypatch.setattr(judged, "compare", lambda equation, *_: found.get(equation.name, NONE))
    own = tuple(record(name, 0.5, 0.4, 0.3, 0.2) for name in found)
    return judged.compare_with_own_flights((before or verdict()).model_copy(update={"own": own}), [])


@pytest.mark.parametrize(
    ("current", "strokes", "condition", "suspected"),
    [
        (LIKE, {}, "unchanged", []),
        (RISEN, {}, "changed", [CURRENT]),
        (LIKE, {TWO_WAYS: RISEN}, "changed", [TWO_WAYS]),
        (LIKE, {TWO_WAYS: LIKE, ROUGHNESS: RISEN, RIPPLE: LEARNING}, "changed", [ROUGHNESS]),
        (RISEN, {TWO_WAYS: RISEN, RIPPLE: RISEN}, "changed", [CURRENT, TWO_WAYS, RIPPLE]),
        (RISEN, {ROUGHNESS: STILL}, "changed", [CURRENT]),
        (LEARNING, {ROUGHNESS: LIKE}, "learning", []),
        (STILL, {RIPPLE: RISEN}, "changed", [RIPPLE]),
        (None, {RIPPLE: RISEN, ROUGHNESS: RISEN}, "changed", [ROUGHNESS, RIPPLE]),
        (None, {RIPPLE: LIKE}, "undecided", []),
    ],
)
def test_strokes_are_beside_the_equation_and_can_only_add_a_change(
    monkeypatch: pytest.MonkeyPatch,
    current: Comparison | None,
    strokes: Mapping[object, Comparison],
    condition: Condition,
    suspected: list[OwnEquation],
) -> None:
    given = {CURRENT: current, **strokes} if current else strokes
    shown = [one for one in (CURRENT, TWO_WAYS, ROUGHNESS, RIPPLE) if one in given]
    found = {one.name: given[one] for one in shown}
    first = compared(monkeypatch, found)
    assert (first.condition, first.worst) == (condition, condition)
    assert [one.fault for one in first.indicators] == [one.fault for one in shown]
    assert [one.kind for one in first.evidence] == [f"{one.fault}_own" for one in shown]
    assert [one.fault for one in first.suspects] == [one.fault for one in suspected]
    # What no longer shows itself leaves nothing of the comparison before.
    again = compared(monkeypatch, dict.fromkeys(found, replace(STILL, value=None)), first)
    assert (again.indicators, again.evidence, again.suspects) == ((), (), ())
