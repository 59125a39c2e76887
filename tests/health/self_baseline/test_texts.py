"""What a comparison with the earlier flights puts into a verdict: texts, numbers, and what stays of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from mavhums.core.conditions import Condition
from mavhums.health.estimation.equations.own_scale import CURRENT, RIPPLE, ROUGHNESS, TRACKING, TWO_WAYS
from mavhums.health.self_baseline import verdict as judged
from mavhums.health.self_baseline.comparison import Comparison
from mavhums.results.reasons import said
from mavhums.results.standing import Interval
from mavhums.results.verdict import Evidence, Indicator, OwnRecord, Suspect, Verdict

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
    groups = tuple((1.0, 0.3, load) for load in loads)
    return OwnRecord(equation=name, setup="by its angle", rate_hz=25.0, duration_s=60.5, groups=groups)


def compared(
    monkeypatch: pytest.MonkeyPatch, found: Mapping[str, Comparison], before: Verdict | None = None
) -> Verdict:
    """Return the verdict on a flight whose equations compare like this with the flights before it."""
    monkeypatch.setattr(judged, "compare", lambda equation, *_: found.get(equation.name, NONE))
    own = tuple(record(name, 0.5, 0.4, 0.3, 0.2) for name in found)
    before = before or Verdict(vehicle=1, actuator="rudder", condition="undecided", worst="undecided")
    return judged.compare_with_own_flights(before.model_copy(update={"own": own}), [])


@pytest.mark.parametrize(
    ("current", "strokes", "condition", "told"),
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
def test_strokes_stand_beside_the_equation_and_can_only_add_a_change(
    monkeypatch: pytest.MonkeyPatch,
    current: Comparison | None,
    strokes: Mapping[object, Comparison],
    condition: Condition,
    told: list[object],
) -> None:
    given = {CURRENT: current, **strokes} if current else strokes
    found = {one.name: given[one] for one in (CURRENT, TWO_WAYS, ROUGHNESS, RIPPLE) if one in given}
    others = ("a", "own", "zz")
    before = Verdict(
        vehicle=1, actuator="rudder", condition="undecided", worst="undecided", reason="it was so",
        indicators=tuple(Indicator(fault=k, quantity="", unit="1", value=VALUE, windows=1) for k in others),
        evidence=tuple(Evidence(kind=one, start_s=0.0, end_s=1.0, value=1.0, rule="") for one in others),
        suspects=tuple(Suspect(fault=one, confidence=0.5) for one in others),
    )  # fmt: skip
    verdict = compared(monkeypatch, found, before)
    shown = [one.fault for one in (CURRENT, TWO_WAYS, ROUGHNESS, RIPPLE) if one.name in found]
    changed = [one for one in (CURRENT, TWO_WAYS, ROUGHNESS, RIPPLE) if one in told]
    reasons = [judged.comparison_reason(one, found[one.name]) for one in changed]
    assert (verdict.condition, verdict.worst) == (condition, condition)
    assert [one.fault for one in verdict.indicators] == [*others, *shown]
    assert [one.kind for one in verdict.evidence] == [*others, *(f"{fault}_own" for fault in shown)]
    assert [one.fault for one in verdict.suspects] == [*others, *(one.fault for one in changed)]
    if changed:
        kept = ("reason", "remedy", "reason_codes")
        assert {name: getattr(verdict, name) for name in kept} == said(*reasons)
    elif current is None:
        assert (verdict.reason, verdict.remedy) == ("it was so", None)
    else:
        assert verdict.reason == judged.comparison_reason(CURRENT, current).text
    assert compared(monkeypatch, found, verdict).indicators == verdict.indicators
    # What no longer shows itself leaves nothing of the comparison before.
    still = replace(STILL, value=None)
    again = compared(monkeypatch, dict.fromkeys(found, still), verdict)
    assert [one.fault for one in again.indicators] == [*others]
    assert [one.kind for one in again.evidence] == [*others]
    assert [one.fault for one in again.suspects] == [*others]


@pytest.mark.parametrize(
    ("condition", "worst"), [("normal", "normal"), ("undecided", "emergency"), ("degraded", "degraded")]
)
def test_beside_a_limit_or_a_jam_strokes_add_nothing(
    monkeypatch: pytest.MonkeyPatch, condition: Condition, worst: Condition
) -> None:
    before = Verdict(vehicle=1, actuator="rudder", condition=condition, worst=worst)
    found = compared(monkeypatch, {CURRENT.name: RISEN, ROUGHNESS.name: RISEN}, before)
    assert (found.condition, found.worst, found.indicators) == (condition, worst, ())


def test_where_no_equation_shows_anything_the_most_informative_one_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for names, told in (((TRACKING, CURRENT), LIKE), ((TRACKING,), RISEN)):
        found = {one.name: LIKE if one == CURRENT else RISEN for one in names}
        assert compared(monkeypatch, found).condition == told.condition
    # Of those that show something the first; the current's record is empty here.
    monkeypatch.setattr(judged, "shows", lambda record: record.equation == TRACKING.name)
    assert compared(monkeypatch, {CURRENT.name: LIKE, TRACKING.name: RISEN}).condition == "changed"
