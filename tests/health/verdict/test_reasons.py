"""The reasons of axes and vehicles that are not judged: every requirement, with its figure and its limit."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mavhums.actuator.telemetry import TIERS
from mavhums.health.axis.findings import AxisFindings
from mavhums.health.axis.reference import STANDARDS
from mavhums.health.verdict.axis import (
    _candidates,
    named_by_telemetry,
    verdict_of_axis,
)
from mavhums.health.verdict.obstacles import disorder, obstacle, why_not_at_all, why_undecided
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Interval
from mavhums.results.verdict import Candidate, Coverage, Evidence, Verdict
from mavhums.vehicle.grid import Received
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import SurfaceOutput, Surfaces

PLANE, COPTER, STATION, ROVER, VTOL = 1, 2, 6, 10, 22
HEARD = {"outputs", "attitude", "rates", "force", "airspeed"}


def flight(**changes: Any) -> Any:
    """Return what the reasons ask of a flight: a healthy one of five minutes, but for the changes."""
    lasted = changes.pop("lasted", {})
    rates = changes.pop("rates", {"outputs": 10.0, "rates": 25.0})
    return SimpleNamespace(
        **{
            "kinds": {PLANE},
            "autopilots": {3},
            "parameters": (),
            "heard": HEARD,
            "on_ground": False,
            "steers": False,
            "by_receiver": (),
            "flown_s": 300,
            "doubted_s": 0,
            "fastest": 20.0,
            "lasted_s": lambda what: lasted.get(what, 0.0),
            "rate_hz": rates.get,
        }
        | changes
    )


def why(*arguments: Any, **changes: Any) -> str:
    found = why_not_at_all(flight(**changes), *arguments)
    return found.reason if found else ""


@pytest.mark.parametrize(
    ("changes", "kind", "reason"),
    [
        ({}, None, ""),
        ({"kinds": {VTOL}}, None, ""),
        ({"kinds": {PLANE, COPTER, STATION}}, "multirotor", ""),
        ({"kinds": set()}, "quadplane", "nothing in the log tells"),
        ({"kinds": set()}, "multirotor", "multirotor: control effectiveness is judged for fixed-wing"),
        ({"kinds": {COPTER}}, "helicopter", "helicopter: control"),
        ({"kinds": {COPTER, 14, STATION}}, None, "a quadrotor and an octorotor: control"),
        ({"kinds": {STATION}}, None, "a ground station: control"),
        ({"heard": set()}, None, "the log lacks the servo outputs and the attitude"),
        ({"flown_s": 0}, None, "it never flew forward: it was never armed"),
        (
            {"flown_s": 0, "lasted": {"armed": 9.0}, "heard": {"outputs", "attitude"}},
            None,
            "whether it flew forward is not known",
        ),
        (
            {"flown_s": 0, "lasted": {"armed": 9.0}, "fastest": 6.4},
            None,
            "it never flew forward: its highest speed while armed was 6 m/s, more than 8 are needed",
        ),
        (
            {"flown_s": 0, "lasted": {"armed": 9.0, "fast": 7.0, "slow": 1.0, "mode": 4.0, "lift": 0.9}},
            None,
            "it never flew forward: of 7 s above 8 m/s (fastest 20 m/s), in 4 s it was in a hovering mode, "
            "in 1 s its ground speed was below 5 m/s",
        ),
        (
            {"flown_s": 0, "lasted": {"armed": 9.0, "fast": 2.0}},
            None,
            "it never flew forward: of 2 s above 8 m/s (fastest 20 m/s), no stretch of the rest lasted 3 s",
        ),
        (
            {"kinds": {ROVER}, "on_ground": True, "steers": True, "flown_s": 0, "fastest": 0.42},
            None,
            "it did not drive forward for 3 s: its highest speed while armed was 0.4 m/s, more than 0.5",
        ),
        ({"kinds": set(), "on_ground": True, "steers": True}, None, ""),
        ({"kinds": {ROVER}, "on_ground": True}, None, "a ground rover: which output steers it"),
    ],
)
def test_why_no_axis_is_judged(changes: dict[str, Any], kind: str | None, reason: str) -> None:
    found = why(kind, **changes)
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


def test_messages_that_are_there_are_not_asked_for() -> None:
    silent = {"heard": HEARD - {"outputs"}}
    assert "(1,200 SERVO_OUTPUT_RAW) and carry no pulses" in why(
        None, {"SERVO_OUTPUT_RAW": Received(1200, 3, 0)}, **silent
    )
    assert "lacks" in why(None, {"SERVO_OUTPUT_RAW": Received(0, 0, 0)}, **silent)
    neither = {"heard": HEARD - {"outputs", "attitude"}}
    told = why(None, {"SERVO_OUTPUT_RAW": Received(1200, 3, 0)}, **neither)
    assert told == "the log lacks the servo outputs and the attitude"
    late = {"SERVO_OUTPUT_RAW": Received(79, 21, 0), "ATTITUDE": Received(80, 20, 0)}
    assert disorder(late) == "of SERVO_OUTPUT_RAW 79 of 100 samples came in time"
    assert why(None, late, **silent).startswith("the servo outputs came too late to be used: of SERVO_OUTPUT")


def test_a_stream_that_comes_too_rarely_is_named_with_its_rate_and_its_own_parameters() -> None:
    rare = {"SERVO_OUTPUT_RAW": Received(60, 0, 0), "ATTITUDE": Received(1200, 0, 0)}
    new = ["SERVO1_FUNCTION", "MAV1_RAW_SENS"]
    flown = flight(heard=HEARD - {"outputs"}, lasted={"recorded": 120.0}, parameters=new)
    reason, remedy = why_not_at_all(flown, None, rare) or ("", "")
    assert reason == "the servo outputs come 0.5 times a second, 3 are needed"
    assert remedy.startswith("judge the log on the autopilot's card (.BIN), or record SERVO_OUTPUT_RAW")
    assert remedy.endswith("(MAVx_RC_CHAN, MAVx_RAW_SENS, MAVx_EXTRA1)")


def test_how_a_rover_steers_is_told_by_its_parameters() -> None:
    ground = {"kinds": {ROVER}, "on_ground": True}
    tank = {"CRUISE_THROTTLE": 1.0, "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    for values, reason in ((tank, "skid steering"), ({"CRUISE_THROTTLE": 1.0}, "name no output that steers")):
        assert reason in why(None, {}, Parameters(1, False, values), **ground)


MOVED = (
    SurfaceOutput(1, "aileron", 1500, 400),
    SurfaceOutput(2, "elevator", 1500, 400),
    SurfaceOutput(4, "rudder", 1500, 400),
)
KNOWN = Surfaces(MOVED, "parameters")


def reference(explained: float = 0.9, error: float = 0.01) -> Any:
    return SimpleNamespace(explained=explained, error=error)


def findings(axis: str = "roll", **changes: Any) -> AxisFindings:
    return replace(
        AxisFindings(
            axis=axis,
            condition="undecided",
            worst="undecided",
            since_s=None,
            coverage=Coverage(moving_fraction=0.1, windows=100, decidable=10),
            suspects=(),
            evidence=(),
            effectiveness=None,
            doubt=None,
            windows=0,
            reference=None,
            best=None,
            usable_s=300,
            spacing_s=0.1,
            needs=STANDARDS[axis],
            limits=AxisLimits(),
        ),
        **changes,
    )


def undecided(one: AxisFindings, surfaces: Surfaces | None = KNOWN, **changes: Any) -> str:
    return why_undecided(one, surfaces, flight(**changes), {}).reason


def test_what_is_too_short_or_unknown() -> None:
    short = "s of forward flight, 45 are needed for a reference and 30 to judge"
    assert undecided(findings(usable_s=44), flown_s=44) == f"44 {short}"
    named = short.replace("flight,", "flight with known outputs,")
    assert undecided(findings(usable_s=44)) == f"44 {named}"
    assert short not in undecided(findings(usable_s=45))
    ground = Surfaces((SurfaceOutput(1, "steering", 1500, 400),), "parameters")
    found = why_undecided(findings("steering", usable_s=44), ground, flight(flown_s=44), {})
    assert found.reason == "44 s of driving forward, 45 are needed for a reference and 30 to judge"
    assert found.remedy == "choose a log with 75 s or more of driving forward, with turns"
    nobody = undecided(findings(), None, flown_s=44)
    assert nobody.startswith(f"44 {short}; which outputs move the surfaces is told neither")
    assert nobody.endswith("44 s of forward flight are too short to learn it")
    assert undecided(findings(), None).endswith("the flight's beginning does not tell it clearly")
    for origin, told in (
        ("parameters", "by its parameters no output"),
        ("profile", "no output of this vehicle is"),
    ):
        assert undecided(findings(), replace(KNOWN, moved=MOVED[1:], origin=origin)).startswith(told)


CHANNELS = replace(KNOWN, moved=(SurfaceOutput(33, "aileron", 1500, 400),))


@pytest.mark.parametrize(
    ("axis", "surfaces", "pulses", "reason"),
    [
        (
            "roll",
            None,
            True,
            "the receiver drives the servos: no output in the log moves, only the receiver's",
        ),
        ("roll", KNOWN, False, "the receiver drives the servos: the log has no output, only the receiver's"),
        ("pitch", CHANNELS, False, "the receiver drives the servos"),
        ("roll", CHANNELS, False, "its surfaces explain 0 %"),
    ],
)
def test_an_axis_whose_servos_the_receiver_drives(
    axis: str, surfaces: Surfaces | None, pulses: bool, reason: str
) -> None:
    flown = flight(by_receiver=(1, 3), has_pulses=pulses)
    found = why_undecided(findings(axis, best=reference(0.0)), surfaces, flown, {})
    assert found.reason.startswith(reason)
    assert ("channels (1, 3)" in found.reason) == ("receiver" in reason)


def test_a_contradicted_profile_is_named_where_it_matters() -> None:
    wrong = replace(KNOWN, origin="profile", contradicted={"roll": "servo 1 is a throttle"})
    assert undecided(findings(), wrong) == "servo 1 is a throttle"
    assert "servo 1 is a throttle" not in undecided(findings("yaw"), wrong)
    assert "servo 1 is a throttle" in undecided(findings("yaw", usable_s=44), wrong)
    assert "servo 1 is a throttle" not in undecided(findings("pitch", usable_s=44), wrong)
    by_log = replace(wrong, by_log=frozenset({"roll"}))
    for changes, told in (({"usable_s": 44}, True), ({}, False), ({"reference": reference()}, False)):
        assert ("servo 1 is a throttle" in undecided(findings(**changes), by_log)) == told


def test_streams_that_are_too_slow_or_absent() -> None:
    slow = {"outputs": 2.0, "rates": 1.5}
    assert undecided(findings(), rates=slow) == (
        "the servo outputs come 2.0 and the rates come 1.5 times a second, 3 are needed to judge roll"
    )
    five = {"outputs": 5.0, "rates": 25.0}
    assert "come 5.0 times a second, 10 are needed to judge pitch" in undecided(findings("pitch"), rates=five)
    assert "times a second" not in undecided(findings(), rates=five)
    unknown = undecided(findings(spacing_s=0.5), rates={})
    assert unknown.startswith("the servo outputs or the rates come 2.0 times a second, 3 are needed")
    for axis, needed in (("roll", False), ("pitch", True), ("yaw", True)):
        reason = undecided(findings(axis), heard=HEARD - {"force"})
        assert (f"the log lacks the accelerometer, which {axis} needs" in reason) == needed
    for seconds, doubted in ((9, False), (10, True)):
        told = "for 10 s the airspeed sensor contradicts" in undecided(findings(), doubted_s=seconds)
        assert told == doubted


@given(short=st.floats(1e-5, 1.0))
@example(short=0.004)
@example(short=0.05)
def test_the_numbers_of_a_reason_show_that_it_is_one(short: float) -> None:
    """What is missed by little is not rounded to what is needed, and what is reached is not called short."""
    needs = replace(STANDARDS["roll"], explained=0.75, error=0.55)

    def of_reference(axis: str, explained: float, error: float) -> str:
        steers = Surfaces((SurfaceOutput(1, "steering", 1500, 400),), "parameters")
        one = findings(axis, best=reference(explained, error), needs=needs)
        return undecided(one, steers if axis == "steering" else KNOWN)

    stood = {"flown_s": 0, "lasted": {"armed": 9.0}}
    driven = {"kinds": {ROVER}, "on_ground": True, "steers": True, "flown_s": 0}
    too_little = [
        why(**stood, fastest=8.0 * (1 - short)),
        why(**driven, fastest=0.5 * (1 - short)),
        *(of_reference(axis, 0.75 * (1 - short), 0.1) for axis in ("roll", "yaw", "steering")),
    ]
    for reason in too_little:
        had, needed = map(float, re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?= m/s, | %|\.?\d* are)", reason)[-2:])
        assert had < needed, reason
    had, needed = map(float, re.findall(r"([\d.]+) %", of_reference("roll", 0.75, 0.55 * (1 + short))))
    assert had > needed
    fast = {**driven, "lasted": {"fast": 3 * short}, "fastest": 0.5 + 4.3 * short}
    [above, fastest] = map(float, re.findall(r"([\d.]+) m/s", why(**fast)))
    assert fastest > above == 0.5


def test_seconds_that_make_no_reference() -> None:
    assert undecided(findings()) == (
        "no 45 s within two minutes were flown within 60° of bank, 34° of pitch and 85 % of the usual speed, "
        "with the surfaces of roll in motion"
    )
    needs = replace(STANDARDS["roll"], explained=0.75, error=0.55)

    def told(axis: str, explained: float, error: float) -> str:
        return undecided(findings(axis, best=reference(explained, error), needs=needs))

    assert told("roll", 0.7, 0.1) == "its surfaces explain 70 % of how it moves in roll, 75 % are needed"
    assert told("roll", 0.75, 0.6) == "the effect of its surfaces is known to 60 %, 55 % are needed"
    assert told("roll", 0.75, 0.55) == ""
    assert told("yaw", 0.7, 0.1).startswith(
        "rudder and aileron cannot be told apart: the rudder explains 70 %"
    )
    assert told("pitch", 0.7, 0.6).count("; ") == 1
    steers = Surfaces((SurfaceOutput(1, "steering", 1500, 400),), "parameters")
    for axis, surfaces, remedy in (
        ("roll", KNOWN, "fly more turns and climbs in the first three minutes"),
        ("yaw", KNOWN, "pulse the rudder alone"),
        ("steering", steers, "check on the ground that the steering follows its commands, then drive more"),
    ):
        one = findings(axis, best=reference(0.7, 0.1), needs=needs)
        assert why_undecided(one, surfaces, flight(), {}).remedy.startswith(remedy)


def test_a_reference_without_a_verdict() -> None:
    kept, doubt = (Interval(estimate=k, low=k - 0.1, high=k + 0.2) for k in (0.7, 0.6))
    excited = "of 100 seconds since the reference were excited enough, 30 are needed"
    known = findings(reference=reference(), effectiveness=kept)
    assert undecided(known) == f"10 {excited}"
    for decidable, doubtful, reason in (
        (29, None, f"29 {excited}"),
        (30, None, "control left 70 % (60–90) is neither certainly above 60 % nor certainly a loss"),
        (30, doubt, "control left 60 % (50–80) is neither certainly above 60 % nor certainly a loss"),
    ):
        coverage = Coverage(moving_fraction=0.1, windows=100, decidable=decidable)
        assert undecided(replace(known, coverage=coverage, doubt=doubtful)) == reason
    coverage = Coverage(moving_fraction=0.1, windows=100, decidable=10, excluded=80)
    assert undecided(replace(known, coverage=coverage)) == (
        f"a loss of 40 % or more is excluded over 80 s of forward flight, but 10 {excited}"
    )
    late = Coverage(moving_fraction=0.1, windows=100, decidable=10, judged_from_s=201.4)
    assert undecided(replace(known, coverage=late)) == (
        f"its reference ends 201 s into the log, and 10 {excited}"
    )


def test_what_a_vehicle_without_a_profile_lacks() -> None:
    tiers = {tier.name: tier for tier in TIERS}
    copter, plane = Identity(1, "quadrotor", multirotor=True), Identity(1, "fixed wing")
    propellers = "quadrotor: a multirotor has no control surfaces whose servos could be judged"
    profile = "no airframe profile: one actuator's limits say nothing about another's"
    for tier, identity, reason in (
        (None, None, "the log carries nothing of the actuators"),
        ("pwm", None, "no servo current or speed in the log, so wear cannot be seen"),
        ("instrumented", None, profile),
        ("esc-signed", None, f"{profile}, and an ESC may"),
        ("esc-signed", copter, f"{propellers}; its ESC"),
        ("pwm", copter, propellers),
        (None, plane, "fixed wing: the log carries nothing of the actuators"),
    ):
        found, _ = obstacle(tiers[tier] if tier else None, identity)
        assert found.startswith(reason)
        assert found == reason or "ESC" in reason


ELEVONS = Surfaces(
    moved=(SurfaceOutput(1, "left elevon", 1500, 400), SurfaceOutput(2, "right elevon", 1500, 400)),
    origin="parameters",
)


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
    ("worst", "order", "told"),
    [
        (("normal", "degraded", "normal"), (2, 1), True),
        (("emergency", "normal", "normal"), (1, 2), True),
        (("normal", "normal", "emergency"), (1, 2), False),
        (("degraded", "degraded", "normal"), (1, 2), False),
        (("undecided", "normal", "normal"), (1, 2), False),
    ],
)
def test_the_candidate_whose_servo_alone_shows_a_fault_comes_first(
    worst: tuple[Any, Any, Any], order: tuple[int, int], told: bool
) -> None:
    def verdict(actuator: str, worst: Any, *candidates: Candidate) -> Verdict:
        return Verdict(vehicle=1, actuator=actuator, condition=worst, worst=worst, candidates=candidates)

    airframe: Any = SimpleNamespace(actuators=[SimpleNamespace(name=f"s{k}", servo=k) for k in (1, 2, 3)])
    both = [Candidate(surface=f"surface {k}", servo=k, probability=0.5, because="it fits") for k in (1, 2)]
    servos = [verdict(f"s{k}", one) for k, one in enumerate(worst, start=1)]
    [found] = named_by_telemetry([verdict("roll", "degraded", *both)], servos, airframe)
    assert tuple(one.servo for one in found.candidates) == order
    if told:
        assert [one.because for one in found.candidates] == ["its servo's telemetry shows a fault", None]
        assert {one.probability for one in found.candidates} == {None}
    else:
        assert list(found.candidates) == both
    [found] = named_by_telemetry([verdict("roll", "degraded", *both)], servos, None)
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
    ("changes", "reason", "remedy"),
    [
        ({}, "", ""),
        ({"condition": "unchanged"}, "the log begins in flight", "record from before take-off"),
        ({"condition": "degraded"}, "", ""),
        ({"judged": 201.4}, "its reference ends 201 s into the log: a loss", "compare with earlier flights"),
        ({"judged": 201.4, "condition": "degraded"}, "", ""),
        ({"condition": "undecided", "usable_s": 44}, "44 s of forward flight with known", "choose a log"),
    ],
)
def test_what_a_normal_axis_does_not_show_is_told(changes: dict[str, Any], reason: str, remedy: str) -> None:
    seen = Coverage(
        moving_fraction=0.123456, windows=99, decidable=40, judged_from_s=changes.pop("judged", None)
    )
    kept = Interval(estimate=0.87654, low=0.76543, high=0.98765)
    told = {"condition": "normal", "worst": "normal", "coverage": seen, "effectiveness": kept, **changes}
    shown = Evidence(kind="slow", start_s=1.0, end_s=2.0, value=0.123456, rule="")
    found = judged(findings(**told, evidence=(shown,)))
    assert found.evidence == (shown.model_copy(update={"value": 0.1235}),)
    assert ((found.reason or "").startswith(reason), bool(found.reason)) == (True, bool(reason))
    assert ((found.remedy or "").startswith(remedy), bool(found.remedy)) == (True, bool(remedy))
    assert found.effectiveness == Interval(estimate=0.877, low=0.765, high=0.988)
    assert (found.coverage.moving_fraction, found.coverage.late) == (0.1235, 5)
