"""What a comparison with the earlier flights puts into a verdict: texts, numbers, and what stays of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf

import pytest

from mavhums.core.conditions import Condition
from mavhums.health.estimation.equations.own_scale import CURRENT, RIPPLE, ROUGHNESS, TRACKING, TWO_WAYS
from mavhums.health.self_baseline import verdict as judged
from mavhums.health.self_baseline.comparison import Comparison, Onset
from mavhums.results.standing import Interval
from mavhums.results.verdict import Evidence, Indicator, OwnRecord, Suspect, Verdict

RISE = Interval(estimate=0.6, low=0.49, high=0.73)
NEAR = Interval(estimate=0.02, low=-0.06, high=0.1)
VALUE = Interval(estimate=0.123456, low=0.103456, high=0.143456)
USUAL = Interval(estimate=0.0987654, low=0.0876543, high=0.1098765)
NO_LIMIT = "no absolute limit known"
LEARNING = Comparison("learning", VALUE, 6, 10)
COLDER = Comparison("undecided", VALUE, 20, 10, why="its flight was colder than any of its baseline")
LIKE = Comparison("unchanged", VALUE, 20, 10, USUAL, NEAR, 0.123456)
RISEN = Comparison("changed", VALUE, 20, 10, USUAL, RISE, 0.123456)
FOUND = "a rise of 12% would have been found"


@pytest.mark.parametrize(
    ("found", "text", "remedy"),
    [
        (LEARNING, f"flight 6 of the 10 that its baseline takes; {NO_LIMIT}", "keep its flights in one"),
        (COLDER, "its flight was colder than any of its baseline", "analyse a flight in which the surface"),
        (LIKE, f"friction current within ±8% of its first 20 flights ({FOUND}); {NO_LIMIT}", None),
        (
            replace(LIKE, load=0.03141, useful_at=3.14159),
            "friction current at a load of 0.031 A within ±8% of its first 20 flights "
            f"({FOUND}, one of 50% at 3.1 false alarms in 100 h); {NO_LIMIT}",
            None,
        ),
        (
            replace(LIKE, useful_at=inf),
            "friction current within ±8% of its first 20 flights "
            f"({FOUND}, one of 50% at no useful rate of false alarms); {NO_LIMIT}",
            None,
        ),
        (RISEN, f"friction current +60% ± 12%: friction; {NO_LIMIT}", "inspect gearbox, bearings and hinge"),
        (
            replace(RISEN, load=2.0, since=Onset(23, "2026-03-23T10:15:00+00:00")),
            "friction current at a load of 2 A +60% ± 12% since flight 23 (2026-03-23): friction; "
            f"{NO_LIMIT}",
            "inspect gearbox, bearings and hinge line",
        ),
    ],
)
def test_what_is_said_of_each_comparison(found: Comparison, text: str, remedy: str | None) -> None:
    assert judged.comparison_text(CURRENT, found) == text
    told = judged.remedy_of(CURRENT, found)
    assert told is None if remedy is None else (told or "").startswith(remedy)


def test_a_weaker_motor_is_told_with_the_rise_that_follows_from_it() -> None:
    told = judged.constant_text(CURRENT, RISEN, 0.2)
    assert told == f"torque constant -20%; the friction current +60% follows from it; {NO_LIMIT}"


def record(name: str, *loads: float) -> OwnRecord:
    """Return what a flight of strokes leaves, or one of the current that shows nothing."""
    groups = tuple((1.0, 0.3, load) for load in loads)
    return OwnRecord(equation=name, setup="by its angle", rate_hz=25.0, duration_s=60.5, groups=groups)


def compared(
    monkeypatch: pytest.MonkeyPatch, found: Mapping[str, Comparison], before: Verdict | None = None
) -> Verdict:
    """Return the verdict on a flight whose equations compare like this with the flights before it."""
    monkeypatch.setattr(judged, "compare", lambda equation, *_: found[equation.name])
    own = tuple(record(name, 0.5, 0.4, 0.3, 0.2) for name in found)
    before = before or Verdict(vehicle=1, actuator="rudder", condition="undecided", worst="undecided")
    return judged.compare_with_own_flights(before.model_copy(update={"own": own}), [])


def test_an_indicator_and_its_evidence_carry_the_digits_that_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = compared(monkeypatch, {TWO_WAYS.name: RISEN})
    [shown], [evidence] = found.indicators, found.evidence
    assert (shown.fault, shown.quantity, shown.unit) == (TWO_WAYS.fault, TWO_WAYS.quantity, "A")
    assert shown.value == Interval(estimate=0.12346, low=0.10346, high=0.14346)
    assert shown.baseline == Interval(estimate=0.098765, low=0.087654, high=0.10988)
    # The interval is two errors to either side; of four parts, each scatters by twice the error.
    assert (shown.windows, shown.scatter) == (4, 0.02)
    assert (shown.baseline_flights, shown.needed_flights) == (20, 10)
    assert (shown.least_rise, shown.load) == (0.1235, 0.35)
    assert (evidence.kind, evidence.start_s, evidence.end_s) == ("friction_both_ways_own", 0.0, 60.5)
    assert (evidence.value, evidence.limit) == (0.12346, 0.098765)
    assert evidence.rule.startswith("changed: current both ways over that at rest +60% ± 12%")
    assert [(one.fault, one.confidence) for one in found.suspects] == [("friction_both_ways", 0.999)]
    [shown] = compared(monkeypatch, {TWO_WAYS.name: LEARNING}).indicators
    assert (shown.baseline, shown.baseline_flights, shown.least_rise) == (None, 6, None)


@pytest.mark.parametrize(
    ("current", "strokes", "condition", "told"),
    [
        (LIKE, {}, "unchanged", []),
        (RISEN, {}, "changed", [CURRENT]),
        (LIKE, {TWO_WAYS: RISEN}, "changed", [TWO_WAYS]),
        (LIKE, {TWO_WAYS: LIKE, ROUGHNESS: RISEN, RIPPLE: LEARNING}, "changed", [ROUGHNESS]),
        (RISEN, {TWO_WAYS: RISEN, RIPPLE: RISEN}, "changed", [CURRENT, TWO_WAYS, RIPPLE]),
        (RISEN, {ROUGHNESS: COLDER}, "changed", [CURRENT]),
        (LEARNING, {ROUGHNESS: LIKE}, "learning", []),
        (COLDER, {RIPPLE: RISEN}, "changed", [RIPPLE]),
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
    texts = {one: judged.comparison_text(one, found[one.name]) for one in changed}
    assert (verdict.condition, verdict.worst) == (condition, condition)
    assert [one.fault for one in verdict.indicators] == [*others, *shown]
    assert [one.kind for one in verdict.evidence] == [*others, *(f"{fault}_own" for fault in shown)]
    assert [one.fault for one in verdict.suspects] == [*others, *(one.fault for one in changed)]
    if changed:
        assert verdict.reason == "; ".join(texts[one] for one in changed)
        assert verdict.remedy == "; ".join(f"inspect {one.inspect}" for one in changed)
    elif current is None:
        assert (verdict.reason, verdict.remedy) == ("it was so", None)
    else:
        assert verdict.reason == judged.comparison_text(CURRENT, current)
    assert compared(monkeypatch, found, verdict).indicators == verdict.indicators
    # What no longer shows itself leaves nothing of the comparison before.
    still = replace(COLDER, value=None)
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
