"""The reasons of axes and vehicles that are not judged: every requirement, with its figures."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mavhums.actuator.telemetry import tier_named
from mavhums.health.axis.findings import AxisFindings
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.verdict.axis import _candidates, named_by_telemetry, verdict_of_axis
from mavhums.health.verdict.obstacles import disorder, obstacle, why_not_at_all, why_undecided
from mavhums.results.reasons import Reason
from mavhums.results.verdict import Candidate, Coverage, Evidence, Interval, Verdict
from mavhums.vehicle.arrivals import Received
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.surfaces import Surfaces
from tests.health.builders import outputs, verdict

PLANE, COPTER, STATION, ROVER, VTOL = 1, 2, 6, 10, 22
HEARD = {"outputs", "attitude", "rates", "force", "airspeed"}


def flight(**changes: Any) -> Any:
    """Return what the reasons ask of a flight: a healthy one of five minutes, but for the changes."""
    lasted = changes.pop("lasted", {})
    rates = changes.pop("rates", {"outputs": 10.0, "rates": 25.0})
    facts = {"kinds": {PLANE}, "autopilots": {3}, "parameters": (), "heard": HEARD}
    moved = {"on_ground": False, "steers": False, "fastest": 20.0}
    seconds = {"flown_s": 300, "doubted_s": 0, "settled_s": 300}
    asked = {"lasted_s": lambda what: lasted.get(what, 0.0), "rate_hz": rates.get}
    return SimpleNamespace(**(facts | moved | seconds | asked | changes))


def why(*arguments: Any, **changes: Any) -> tuple[Reason, ...]:
    return why_not_at_all(flight(**changes), *arguments)


def codes(*reasons: Reason) -> list[str]:
    return [one.code for one in reasons]


STOOD = {"flown_s": 0, "lasted": {"armed": 9.0}}
DRIVES = {"kinds": {ROVER}, "on_ground": True, "steers": True}


@pytest.mark.parametrize(
    ("changes", "kind", "code"),
    [
        ({}, None, ""),
        ({"kinds": {VTOL}}, None, ""),
        ({"kinds": {PLANE, COPTER, STATION}}, "multirotor", ""),
        ({"kinds": set()}, "quadplane", "unknown_kind"),
        ({"kinds": set()}, "multirotor", "no_wings"),
        ({"kinds": {COPTER}}, "helicopter", "no_wings"),
        ({"kinds": {COPTER, 14, STATION}}, None, "no_wings"),
        ({"heard": set()}, None, "lacks"),
        ({"flown_s": 0}, None, "never_armed"),
        ({**STOOD, "heard": {"outputs", "attitude"}}, None, "no_speed"),
        ({**STOOD, "fastest": 6.4}, None, "too_slow"),
        ({**STOOD, "lasted": {"armed": 9.0, "fast": 2.0}}, None, "stopped"),
        ({**DRIVES, "flown_s": 0, "fastest": 0.42}, None, "too_slow"),
        ({**DRIVES, "kinds": set()}, None, ""),
        ({**DRIVES, "steers": False}, None, "steering_unknown"),
    ],
)
def test_why_no_axis_is_judged(changes: dict[str, Any], kind: str | None, code: str) -> None:
    assert codes(*why(kind, **changes)) == [code] * bool(code)


def test_messages_that_are_there_are_not_asked_for() -> None:
    silent, neither = {"heard": HEARD - {"outputs"}}, {"heard": HEARD - {"outputs", "attitude"}}
    there = {"SERVO_OUTPUT_RAW": Received(1200, 3, 0)}
    late = {"SERVO_OUTPUT_RAW": Received(79, 21, 0), "ATTITUDE": Received(80, 20, 0)}
    for received, changes, code in (
        (there, silent, "no_pulses"),
        ({"SERVO_OUTPUT_RAW": Received(0, 0, 0)}, silent, "lacks"),
        (there, neither, "lacks"),
        (late, silent, "no_sample_in_time"),
    ):
        assert codes(*why(None, received, **changes)) == [code]
    assert disorder(late) == "of SERVO_OUTPUT_RAW 79 of 100 samples came in time"


def test_a_stream_that_comes_too_rarely_is_named_with_its_rate_and_its_own_parameters() -> None:
    rare = {"SERVO_OUTPUT_RAW": Received(60, 0, 0), "ATTITUDE": Received(1200, 0, 0)}
    new = ["SERVO1_FUNCTION", "MAV1_RAW_SENS"]
    flown = {"heard": HEARD - {"outputs"}, "lasted": {"recorded": 120.0}, "parameters": new}
    [found] = why(None, rare, **flown)
    assert found.code == "too_rare"
    assert "come 0.5 times" in found.text
    assert found.remedy.endswith("(MAVx_RC_CHAN, MAVx_RAW_SENS, MAVx_EXTRA1)")


MOVED = outputs(aileron=1, elevator=2, rudder=4)
KNOWN = Surfaces(MOVED, "parameters")


def reference(error: float = 0.01, apart: float = 0.05) -> Any:
    return SimpleNamespace(error=error, apart=apart)


def findings(axis: str = "roll", **changes: Any) -> AxisFindings:
    coverage = Coverage(moving_fraction=0.1, windows=100, decidable=10)
    known = replace(AxisMonitor(1).findings("roll"), axis=axis, coverage=coverage)
    return replace(known, **({"usable_s": 300, "spacing_s": 0.1} | changes))


def undecided(one: AxisFindings, surfaces: Surfaces | None = KNOWN, **changes: Any) -> list[Reason]:
    return [*why_undecided(one, surfaces, flight(**changes), {})]


STEERS = Surfaces(outputs(steering=1), "parameters")
NO_ROLL = replace(KNOWN, moved=MOVED[1:])
WRONG = replace(KNOWN, origin="profile", contradicted={"roll": "servo 1 is a throttle"})
BY_LOG = replace(WRONG, by_log=frozenset({"roll"}))
SLOW = {"rates": {"outputs": 5.0, "rates": 25.0}}
NO_FORCE = {"heard": HEARD - {"force"}}
SHORT: dict[str, Any] = {"usable_s": 44}


@pytest.mark.parametrize(
    ("axis", "shown", "surfaces", "flown", "code", "given"),
    [
        ("roll", SHORT, KNOWN, {"flown_s": 44}, "too_short", True),
        ("roll", SHORT, KNOWN, {}, "too_short", True),
        ("roll", {"usable_s": 45}, KNOWN, {}, "too_short", False),
        ("steering", SHORT, STEERS, {"flown_s": 44}, "too_short", True),
        ("roll", {}, None, {"flown_s": 44}, "too_short", True),
        ("roll", {}, None, {"flown_s": 44}, "outputs_unknown", True),
        ("roll", {}, NO_ROLL, {}, "moved_by_none", True),
        ("roll", {}, replace(NO_ROLL, origin="profile"), {}, "moved_by_unknown", True),
        # A contradicted profile is named where it matters.
        ("roll", {}, WRONG, {}, "outputs_contradicted", True),
        ("yaw", {}, WRONG, {}, "outputs_contradicted", False),
        ("yaw", SHORT, WRONG, {}, "outputs_contradicted", True),
        ("pitch", SHORT, WRONG, {}, "outputs_contradicted", False),
        ("roll", SHORT, BY_LOG, {}, "outputs_contradicted", True),
        ("roll", {}, BY_LOG, {}, "outputs_contradicted", False),
        ("roll", {"reference": reference()}, BY_LOG, {}, "outputs_contradicted", False),
        # Streams that are too slow or absent.
        ("roll", {}, KNOWN, {"rates": {"outputs": 2.0, "rates": 1.5}}, "stream_too_slow", True),
        ("roll", {"spacing_s": 0.5}, KNOWN, {"rates": {}}, "stream_too_slow", True),
        ("pitch", {}, KNOWN, SLOW, "stream_too_slow", False),
        ("pitch", {}, KNOWN, NO_FORCE, "lacks", True),
        ("yaw", {}, KNOWN, NO_FORCE, "lacks", True),
        ("roll", {}, KNOWN, NO_FORCE, "lacks", False),
        ("roll", {}, KNOWN, {"doubted_s": 9}, "airspeed_doubted", False),
        ("roll", {}, KNOWN, {"doubted_s": 10}, "airspeed_doubted", True),
        ("roll", {}, KNOWN, {}, "no_reference", True),
        ("roll", {}, KNOWN, {"settled_s": 44}, "wind_unknown", False),
        ("pitch", {}, KNOWN, {"settled_s": 44}, "wind_unknown", True),
        ("pitch", {}, KNOWN, {"settled_s": 45}, "wind_unknown", False),
        ("steering", {}, STEERS, {}, "steering_still", True),
        # A reference without a verdict.
        ("roll", {"reference": reference()}, KNOWN, {}, "unexcited", True),
    ],
)
def test_each_requirement_that_an_axis_does_not_meet_is_named(
    axis: str, shown: Any, surfaces: Surfaces | None, flown: Any, code: str, given: bool
) -> None:
    assert (code in codes(*undecided(findings(axis, **shown), surfaces, **flown))) is given


@given(short=st.floats(1e-5, 1.0))
@example(short=0.004)
@example(short=0.05)
def test_the_numbers_of_a_reason_show_that_it_is_one(short: float) -> None:
    """What is missed by little is not rounded to what is needed, and what is reached is not called short."""

    def of_reference(axis: str, error: float, apart: float = 0.05) -> str:
        one = findings(axis, best=reference(error, apart))
        return "; ".join(each.text for each in undecided(one, STEERS if axis == "steering" else KNOWN))

    driven = {**DRIVES, "flown_s": 0}
    for too_little in (STOOD | {"fastest": 8.0 * (1 - short)}, driven | {"fastest": 0.5 * (1 - short)}):
        reason = why(**too_little)[0].text
        had, needed = map(float, re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?= m/s, | %|\.?\d* are)", reason)[-2:])
        assert had < needed, reason
    too_much = [
        *(of_reference(axis, 0.08 * (1 + short)) for axis in ("roll", "yaw", "steering")),
        *(of_reference(axis, 0.05, 0.2 * (1 + short)) for axis in ("pitch", "yaw", "steering")),
    ]
    for reason in too_much:
        had, allowed = map(float, re.findall(r"([\d.]+) %", reason))
        assert had > allowed, reason
    fast = {**driven, "lasted": {"fast": 3 * short}, "fastest": 0.5 + 4.3 * short}
    [above, fastest] = map(float, re.findall(r"([\d.]+) m/s", why(**fast)[0].text))
    assert fastest > above == 0.5


@pytest.mark.parametrize(
    ("axis", "error", "apart", "expected"),
    [
        ("roll", 0.08, 0.2, []),
        ("pitch", 0.15, 0.05, ["effect_uncertain"]),
        ("pitch", 0.05, 0.7, ["inseparable"]),
        ("yaw", 0.15, 0.05, ["rudder_uncertain"]),
        ("yaw", 0.05, 0.7, ["rudder_inseparable"]),
        ("steering", 0.15, 0.7, ["steering_uncertain"]),
        ("roll", float("inf"), float("inf"), ["effect_uncertain"]),
    ],
)
def test_seconds_that_make_no_reference(axis: str, error: float, apart: float, expected: list[str]) -> None:
    one = findings(axis, best=reference(error, apart))
    assert codes(*undecided(one, STEERS if axis == "steering" else KNOWN)) == expected


def test_streams_out_of_order_are_named_last() -> None:
    found = why_undecided(findings(), KNOWN, flight(), {"A": Received(70, 30, 0)})
    assert codes(*found)[-1] == "out_of_order"


def test_a_reference_without_a_verdict() -> None:
    kept, doubt = (Interval(estimate=k, low=k - 0.1, high=k + 0.2) for k in (0.7, 0.6))
    known = findings(reference=reference(), effectiveness=kept)
    seen = {"moving_fraction": 0.1, "windows": 100}
    excluded = "a loss of 40 % or more is excluded over"
    of = "of the 100 s since the reference, 30 are needed"
    for counted, doubtful, reason in (
        ({"decidable": 29}, None, f"{excluded} 29 {of}"),
        ({"decidable": 30}, None, "control left 70 % (60–90) is neither certainly above 60 % nor"),
        ({"decidable": 30}, doubt, "control left 60 % (50–80) is neither certainly above 60 % nor"),
        (
            {"decidable": 10, "judged_from_s": 201.4},
            None,
            f"its reference ends 201 s into the log, and {excluded} 10 {of}",
        ),
    ):
        coverage = Coverage.model_validate(seen | counted)
        [found] = undecided(replace(known, coverage=coverage, doubt=doubtful))
        assert found.text.startswith(reason)
        assert found.code == ("uncertain_loss" if counted["decidable"] == 30 else "unexcited")


def test_the_escs_of_a_multirotor_are_those_of_its_propellers() -> None:
    copter = Identity(1, "quadrotor", multirotor=True)
    assert codes(*obstacle(tier_named("esc-signed"), copter)) == ["multirotor", "propeller_escs"]


ELEVONS = Surfaces(outputs(left_elevon=1, right_elevon=2), "parameters")


@pytest.mark.parametrize(
    ("shares", "named"),
    [
        ({"left": 0.9, "right": 0.06, "both": 0.04}, [(1, 0.9), (2, 0.06)]),
        ({"left": 0.04, "right": 0.96, "both": 0.0}, [(2, 0.96), (1, 0.04)]),
        ({"left": 1.0, "right": 0.0, "both": 0.0}, [(1, 0.99), (2, 0.0)]),
        ({"left": 0.894, "right": 0.1, "both": 0.006}, [(1, None), (2, None)]),
        ({"left": 0.03, "right": 0.02, "both": 0.95}, [(1, None), (2, None)]),
        ({}, [(1, None), (2, None)]),
    ],
)
def test_of_two_mixed_surfaces_one_is_named_if_it_is_nearly_certain(
    shares: dict[str, float], named: list[tuple[int, float | None]]
) -> None:
    findings: Any = SimpleNamespace(axis="roll", shares=shares)
    found = _candidates(findings, ELEVONS)
    assert [(one.servo, one.probability) for one in found] == named
    assert all((one.because is None) == (one.probability is None) for one in found)


@pytest.mark.parametrize(
    ("worst", "order", "named"),
    [
        (("normal", "degraded", "normal"), (2, 1), True),
        (("emergency", "normal", "normal"), (1, 2), True),
        (("normal", "normal", "emergency"), (1, 2), False),
        (("degraded", "degraded", "normal"), (1, 2), False),
        (("undecided", "normal", "normal"), (1, 2), False),
    ],
)
def test_the_candidate_whose_servo_alone_shows_a_fault_comes_first(
    worst: tuple[Any, Any, Any], order: tuple[int, int], named: bool
) -> None:
    airframe: Any = SimpleNamespace(actuators=[SimpleNamespace(name=f"s{k}", servo=k) for k in (1, 2, 3)])
    both = [Candidate(surface=f"surface {k}", servo=k, probability=0.5, because="it fits") for k in (1, 2)]
    servos = [verdict(one, actuator=f"s{k}") for k, one in enumerate(worst, start=1)]
    axis = verdict("degraded", actuator="roll", candidates=tuple(both))
    [found] = named_by_telemetry([axis], servos, airframe)
    assert tuple(one.servo for one in found.candidates) == order
    if named:
        assert [one.because for one in found.candidates] == ["its servo's telemetry shows a fault", None]
        assert {one.probability for one in found.candidates} == {None}
    else:
        assert list(found.candidates) == both
    [found] = named_by_telemetry([axis], servos, None)
    assert list(found.candidates) == both


def judged(one: AxisFindings, surfaces: Surfaces | None = KNOWN, **changes: Any) -> Verdict:
    """Return the verdict on an axis whose sensors had these seconds."""
    used = changes.pop("used", {})
    received = {"A": Received(10, 2, 0), "B": Received(20, 3, 0)}
    grid: Any = SimpleNamespace(received=lambda: received, source=lambda name, rank: f"{name} {rank}")
    flown = flight(**changes)
    flown.used_s = lambda name: used.get(name, {})
    return verdict_of_axis(1, one, surfaces, flown, datetime(2026, 3, 1, tzinfo=UTC), grid)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ()),
        ({"condition": "unchanged"}, ("begins_in_flight",)),
        ({"condition": "degraded"}, ()),
        ({"judged": 201.4}, ("late_reference",)),
        ({"judged": 201.4, "condition": "degraded"}, ()),
        ({"condition": "undecided", "usable_s": 44}, ("too_short",)),
    ],
)
def test_what_a_normal_axis_does_not_show_is_said(changes: dict[str, Any], expected: tuple[str, ...]) -> None:
    judged_s = changes.pop("judged", None)
    seen = Coverage(moving_fraction=0.123456, windows=99, decidable=40, judged_from_s=judged_s)
    kept = Interval(estimate=0.87654, low=0.76543, high=0.98765)
    fields = {"condition": "normal", "worst": "normal", "coverage": seen, "effectiveness": kept, **changes}
    shown = Evidence(kind="slow", start_s=1.0, end_s=2.0, value=0.123456, rule="")
    found = judged(findings(**fields, evidence=(shown,)))
    assert found.evidence == (shown.model_copy(update={"value": 0.1235}),)
    assert found.reason_codes == expected
    assert found.effectiveness == Interval(estimate=0.877, low=0.765, high=0.988)
    assert (found.coverage.moving_fraction, found.coverage.late) == (0.1235, 5)
