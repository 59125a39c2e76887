"""What a table says of one verdict, of several alike, and of a vehicle that is not judged."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.results.assessment import Assessment
from mavhums.results.reasons import NO_WINGS, PROPELLERS_ONLY
from mavhums.results.sections import FlightEvent
from mavhums.results.verdict import Coverage, Evidence, Interval, Verdict
from mavhums.show.curves import EvidenceCollector
from mavhums.show.headline import NOT_JUDGED, headline
from mavhums.show.html import page
from mavhums.show.markdown_report import markdown
from mavhums.show.verdict_words import control_left
from tests.show.conftest import new_assessment
from tests.show.test_terminal import rendered

UNSEEN = "nothing reports on it"

SLOW = "degraded: 25 % of the commanded roll is answered in time (gain intact, 1 s late)"
LATE = Evidence(kind="slow", start_s=104.0, end_s=160.0, value=1.0, rule=SLOW)
FEW = Coverage(moving_fraction=0.1, windows=157, decidable=9)


def axis(name: str = "roll", condition: str = "normal", **more: object) -> Verdict:
    worst = more.pop("worst", condition)
    fields = {"subject": "axis", "vehicle": 1, "actuator": name, "condition": condition, "worst": worst}
    return Verdict.model_validate(fields | more)


def left(estimate: float, low: float, high: float) -> Interval:
    return Interval(estimate=estimate, low=low, high=high)


def servo(number: int) -> Verdict:
    fields = {"subject": "actuator", "reason": UNSEEN, "remedy": "record its current"}
    return axis(f"aileron (servo {number})", "unmonitored", **fields)


def copter(kind: str, reason: str, remedy: str) -> tuple[Verdict, Verdict]:
    axes = axis("axes", "undecided", reason=f"a {kind}: fixed wings only", remedy=NO_WINGS)
    return axes, axis("all", "undecided", subject="actuator", reason=reason, remedy=remedy)


WIDE = axis(condition="undecided", effectiveness=left(0.54, -1.02, 2.1), coverage=FEW)


def shown(assessment: Assessment, width: int = 200, *, verbose: bool = False) -> str:
    return rendered(assessment, width=width, verbose=verbose)


@pytest.mark.parametrize(
    ("verdict", "left"),
    [
        (axis(), "no loss"),
        (axis(condition="undecided"), None),
        (axis(effectiveness=left(1.19, 1.1, 1.28)), "no loss"),
        (axis(effectiveness=left(0.9, 0.85, 0.95)), "90 % (85–95)"),
        (axis(condition="degraded", effectiveness=left(1.02, 0.9, 1.1)), "102 % (90–110)"),
        (WIDE, "not reliable: 9 of 30 s judged"),
        (axis(condition="degraded", effectiveness=left(0.54, -1.02, 2.1)), "not reliable"),
        (axis(condition="degraded", effectiveness=left(0.25, 0.19, 0.31), evidence=(LATE,)), SLOW[58:-1]),
    ],
)
def test_a_figure_is_shown_as_far_as_it_can_be_relied_on(verdict: Verdict, left: str | None) -> None:
    assert control_left(verdict) == left


def test_an_interval_that_shows_nothing_is_nowhere() -> None:
    assessment = new_assessment(WIDE)
    for text in (markdown(assessment), page(assessment, EvidenceCollector())):
        assert not re.search("[−-]102", text)
    assert "9 of 157 s" in shown(assessment, verbose=True)


@pytest.mark.parametrize("condition", ["undecided", "normal", "degraded"])
def test_an_alarm_that_is_past_says_from_when_to_when(condition: str) -> None:
    alarm = Evidence(kind="tracking", start_s=90, end_s=127, value=9, rule="emergency: roll 24° away")
    before = Evidence(kind="slow", start_s=60, end_s=90, value=0.4, rule="degraded: gain intact, 0.4 s late")
    verdict = axis(condition=condition, worst="emergency", evidence=(before, alarm))
    assessment = new_assessment(verdict)
    then = condition.upper() if condition == "degraded" else condition
    assert re.search(rf"EMERGENCY 1m30s–2m07s, then . {then}", shown(assessment))
    assert f"EMERGENCY: roll control: slow, 0.4 s late, 1m30s–2m07s, then {condition}" in shown(assessment)


def test_where_all_is_well_the_good_news_comes_first() -> None:
    open_ = axis("yaw", "undecided", reason="too few pulses", remedy="pulse the rudder")
    assessment = new_assessment(open_, axis("roll"), axis("pitch"), servo(1))
    text = shown(assessment)
    assert "partly judged: roll and pitch control within their limits; yaw control not judged;" in text
    rows = [line.split()[0] for line in text.splitlines() if line.startswith((" roll", " pitch", " yaw"))]
    assert rows == ["roll"], "and pitch: both rows say the same"
    html = page(assessment, EvidenceCollector())
    table = html[html.index("<tbody") :]
    assert table.index("roll and pitch control") < table.index("yaw control") < table.index("wear of")
    alarmed = shown(new_assessment(axis("pitch"), open_, axis("roll", "degraded")))
    assert alarmed.index("DEGRADED") < alarmed.rindex("normal") < alarmed.index("Not judged: yaw control")
    assert headline(assessment).condition == "undecided", "as the exit code is"


def test_six_servos_without_telemetry_are_one_line() -> None:
    assessment = new_assessment(axis(), *(servo(k) for k in range(1, 7)))
    assert "6 servos" not in shown(assessment)
    text = " ".join(shown(assessment, verbose=True).split())
    assert f"6 actuators: unmonitored: {UNSEEN} what to do: record its current" in text
    assert page(assessment, EvidenceCollector()).count(UNSEEN) == text.count(UNSEEN) == 1
    assert markdown(assessment).count("wear of 6 actuators") == 1


def test_the_picture_says_of_what_a_colour_is() -> None:
    """A servo of its own is unmonitored; what is drawn on its surface is the axis's condition."""
    surfaces = ("aileron (servo 1)",)
    html = page(new_assessment(axis(condition="degraded", surfaces=surfaces), servo(1)), EvidenceCollector())
    assert "aileron (servo 1), by roll control" in html
    assert "<title>aileron (servo 1): degraded" not in html
    assert "wear of aileron (servo 1)" in html


def test_a_copter_is_one_line() -> None:
    both = copter("quadrotor", "quadrotor: a multirotor has no control surfaces", PROPELLERS_ONLY)
    assessment = new_assessment(*both)
    line = f"A quadrotor: {NOT_JUDGED}"
    text = shown(assessment).splitlines()
    assert text[0] == f"? undecided: {line}"
    assert len(text) == 2  # the headline; earlier flights and the notice
    assert "remedy" not in shown(assessment)
    for whole in (markdown(assessment), page(assessment, EvidenceCollector())):
        assert line in whole
        assert NO_WINGS not in whole
    beside = shown(new_assessment(*both, axis(vehicle=2)))
    assert "vehicle 1: a quadrotor: not judged" in beside


def test_a_rover_whose_servo_reports_keeps_its_remedy() -> None:
    assert "What to do: draft one" in shown(new_assessment(*copter("ground rover", "r", "draft one")))


def test_a_headline_names_the_part_and_the_kind_of_fault() -> None:
    trim = Evidence(kind="hard_over", start_s=90, end_s=95, value=9, rule="emergency: rolls left 67°/s more")
    less = Evidence(kind="effectiveness", start_s=90, end_s=95, value=0.5, rule="emergency: 50 % is left")
    left_, right = ({"surface": f"{side} elevon", "servo": k} for k, side in ((2, "left"), (1, "right")))
    lost: dict[str, Any] = {
        "since": {"flight_time_s": 149.0, "utc": ""},
        "effectiveness": left(0.5, 0.4, 0.6),
    }
    because = {"probability": 0.99, "because": "the demand about one axis moves the aircraft about the other"}
    servos = [{"surface": "moves with roll", "servo": k} for k in (4, 5)]
    down = "roll control down to 50 %"
    trimmed = "left elevon (servo 2), probably: seems deflected or stuck, pulls left"
    for candidates, evidence, begin in (
        ((left_ | because, right), (trim, less), trimmed),
        ((left_, right), (less,), f"left elevon (servo 2), right elevon (servo 1) or both: {down}"),
        (servos, (less,), f"servo 4, servo 5 or both (they move with roll): {down}"),
        ((), (less,), down),
    ):
        verdict = axis("roll", "emergency", **lost, candidates=candidates, evidence=evidence)
        text = headline(new_assessment(verdict)).text
        assert text.startswith(begin)
        assert text.endswith("since 2m29s")


@pytest.mark.parametrize(
    ("kind", "words"),
    [("crash", "crash: crash reported at 1m20s"), ("contact", "contact: probably hit something")],
)
def test_a_crash_is_not_a_plain_undecided(kind: str, words: str) -> None:
    happened = {"kind": kind, "vehicle": 1, "time_s": 80.0, "said": "Crash: Disarming"}
    unknown = new_assessment(axis(condition="undecided", reason="too short", remedy="fly longer"))
    assessment = unknown.model_copy(update={"events": (FlightEvent.model_validate(happened),)})
    first = shown(assessment).splitlines()[0]
    assert words in first
    assert "roll control not judged" in first
    assert assessment.exit_code == unknown.exit_code
    assert headline(assessment).condition in ("emergency", "degraded")


EVENTS = {
    "crash": "do not fly; inspect frame",
    "impact": "inspect fuselage",
    "supply": "inspect the BEC",
    "contact": "inspect propellers",
    "altitude_loss": "inspect motor or engine",
}


@pytest.mark.parametrize("verbose", [False, True])
@pytest.mark.parametrize(("kind", "todo"), EVENTS.items())
def test_the_headline_of_an_event_says_what_to_inspect(kind: str, todo: str, verbose: bool) -> None:
    event = FlightEvent.model_validate({"kind": kind, "vehicle": 1, "time_s": 80.0, "value": 3.0})
    unknown = axis(condition="undecided", reason="too short", remedy="fly longer")
    well = axis(condition="normal", reason="3 s were judged")
    lost = axis("roll", "emergency", advice="do not fly; inspect aileron")
    for verdict, line in (
        (unknown, f"What to do: {todo}"),
        (well, f"What to do: {todo}"),
        (lost, f"What to do: do not fly; inspect aileron; {todo}"),
    ):
        assessment = new_assessment(verdict).model_copy(update={"events": (event,)})
        assert line in shown(assessment, verbose=verbose)
        assert ("what to do: fly longer" in shown(assessment, verbose=verbose)) == (verdict is unknown)


REASONS = (
    "too few pulses",
    "its surfaces explain 4 % of how it moves, 30 % are needed; no airspeed",
    "x " * 90,
)
CONDITIONS: tuple[Condition, ...] = (
    "normal",
    "unchanged",
    "learning",
    "undecided",
    "changed",
    "degraded",
    "emergency",
)


@given(
    st.lists(
        st.tuples(st.sampled_from(CONDITIONS), st.sampled_from(CONDITIONS), st.sampled_from(REASONS)),
        min_size=1,
        max_size=9,
    )
)
def test_a_short_answer_fits_a_screen_and_leaves_nobody_out(
    states: list[tuple[Condition, Condition, str]],
) -> None:
    """The gravest subject comes first, and each one somewhere."""
    names = ["roll", "pitch", "yaw", *(f"flap_{place}" for place in "abcdef")]
    alarm = Evidence(kind="effectiveness", start_s=90, end_s=127, value=0.2, rule="")
    verdicts = []
    for k, (name, (one, other, reason)) in enumerate(zip(names, states, strict=False)):
        condition, worst = sorted((one, other), key=SEVERITY.__getitem__)
        verdict = axis(name, condition, worst=worst, reason=reason, remedy=f"see to {reason[:20]}")
        faulty = {"degraded", "emergency"} & {worst, condition}
        evidence = (
            (alarm.model_copy(update={"condition": worst, "rule": f"{k} % is left"}),) if faulty else ()
        )
        subject = "axis" if name in names[:3] else "actuator"
        verdicts.append(verdict.model_copy(update={"subject": subject, "evidence": evidence}))
    assessment = new_assessment(*verdicts)
    text = shown(assessment, 100)
    lines = [line for line in text.splitlines() if line.strip()]
    named = {name: re.search(rf"\b{name}\b", text) for name in names[: len(states)]}
    alike = re.search(r"\d actuators", text)
    assert all(place or alike for place in named.values())
    gravest = [one for one in verdicts if one.gravest == assessment.ranked()[0].gravest]
    assert any(one.actuator in " ".join(lines[:3]) for one in gravest) or alike
    assert len(lines) <= 24
