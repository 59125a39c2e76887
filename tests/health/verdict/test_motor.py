"""From what a flight shows of its motors to verdicts, and beside the flights before it."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from math import exp
from types import SimpleNamespace
from typing import Any

import pytest

from mavhums.core.conditions import Condition
from mavhums.health.decision.baseline import Baseline
from mavhums.health.motor.monitor import TRIM, TRIM_YAW, MotorFindings, ThrustLoss
from mavhums.health.motor.speeds import SpeedCause
from mavhums.health.verdict.motor import compare_motors, verdicts_of_motors
from mavhums.results.reasons import Reason
from mavhums.results.verdict import Coverage, Evidence, Interval, Verdict
from tests.health.builders import indicator, verdict
from tests.health.motor.test_monitor import rotors
from tests.present import present

START = datetime(2026, 3, 1, 9, tzinfo=UTC)
QUAD = rotors("quad x")
LOSS = ThrustLoss(2, 41.239, 40.123, Interval(estimate=0.4004, low=0.2996, high=0.6004), 3.0)
FINDINGS = MotorFindings(QUAD, None, (), 90.0, 60.0, False, (0.1, 0.31, 0.2, 0.0), ((), (), (), ()))


def verdicts(findings: MotorFindings | None, known: Any = QUAD, *, lacks: str = "") -> list[Verdict]:
    heard = {"outputs", "attitude", "rates"} - {lacks}
    flight: Any = SimpleNamespace(heard=heard, autopilots={3}, parameters=(), lasted_s=lambda _: 60.0)
    return [*verdicts_of_motors(1, findings, known, flight, START)]


@pytest.mark.parametrize(
    ("changes", "lacks", "code"),
    [
        ({}, "outputs", "lacks"),
        ({}, "attitude", "lacks"),
        ({}, "rates", "lacks"),
        ({"tipped": True}, "", "leaned"),
        ({"judged_s": 29.9}, "", "hover_too_short"),
    ],
)
def test_why_no_motor_is_judged(changes: dict[str, Any], lacks: str, code: str) -> None:
    [found] = verdicts(replace(FINDINGS, **changes), lacks=lacks)
    assert (found.actuator, found.condition, found.worst) == ("motors", "undecided", "undecided")
    assert found.reason_codes == (code,)


@pytest.mark.parametrize("unknown", [None, Reason("no_parameter", name="FRAME_TYPE")])
def test_motors_that_are_not_known(unknown: Reason | None) -> None:
    [found] = verdicts(None, unknown)
    assert found.condition == "undecided"
    assert found.reason_codes == (unknown.code if unknown else "motors_unknown",)


def test_a_loss_is_one_verdict_on_its_motor() -> None:
    cause = SpeedCause(0.80049, 40.5, 49.5, "its speed lags")
    [found] = verdicts(replace(FINDINGS, loss=LOSS, tipped=True, judged_s=1.0, cause=cause))
    assert (found.actuator, found.condition, found.worst) == ("motor 2", "degraded", "degraded")
    assert found.effectiveness == Interval(estimate=0.6, low=0.4, high=0.7)
    assert found.suspects[0].confidence == round(1.0 / (1.0 + exp(-3.0)), 3)
    assert present(found.since).flight_time_s == 40.123
    loss, speed = found.evidence
    assert (loss.start_s, loss.end_s, loss.value) == (40.12, 41.24, 0.4)
    assert loss.rule == "degraded: lost 40 % of its thrust (30 to 60 %)"
    assert (speed.start_s, speed.end_s, speed.value, speed.rule) == (40.5, 49.5, 0.8, "its speed lags")
    assert (found.coverage.windows, found.coverage.decidable) == (90, 1)
    assert found.coverage.moving_fraction == pytest.approx(1 / 90, abs=5e-5)
    assert found.provenance["V1"].startswith("output 2,")
    [sure] = verdicts(replace(FINDINGS, loss=replace(LOSS, odds=700.0)))
    assert sure.suspects[0].confidence == 1.0
    assert len(sure.evidence) == 1
    for flown_s, judged_s, covered in ((0.9, 0.0, (0.0, 0, 0)), (1, 2, (1, 2, 2))):
        [found] = verdicts(replace(FINDINGS, loss=LOSS, flown_s=flown_s, judged_s=judged_s))
        coverage = found.coverage
        assert (coverage.moving_fraction, coverage.windows, coverage.decidable) == covered


@pytest.mark.parametrize(
    ("bound", "condition", "code"),
    [
        (0.31, "normal", "motors_normal"),
        (0.7, "normal", "motors_normal"),  # 0.1 · 7 is more
        (0.75, "undecided", "motors_uncertain"),
    ],
)
def test_a_flight_without_a_loss_says_which_one_it_excludes(
    bound: float, condition: Condition, code: str
) -> None:
    shown = tuple((indicator(TRIM, float(k)),) for k in range(4))
    found = verdicts(replace(FINDINGS, bound=(0.1, bound, 0.2, 0.0), indicators=shown))
    assert [one.actuator for one in found] == [f"motor {k}" for k in range(1, 5)]
    assert {one.condition for one in found} == {condition}
    assert {one.reason_codes for one in found} == {(code,)}
    assert (f" lost {100 * bound:.0f} % or more" in (found[0].reason or "")) is (condition == "normal")
    assert [one.indicators[0].value.estimate for one in found] == [0.0, 1.0, 2.0, 3.0]
    assert [one.provenance["V1"][:8] for one in found] == [f"output {k}" for k in range(1, 5)]


@pytest.mark.parametrize(("lost", "worst"), [(0.4, "normal"), (0.9, "emergency")])
def test_of_losses_that_were_withdrawn_only_a_stop_stays_the_worst(lost: float, worst: str) -> None:
    share = Interval(estimate=lost, low=lost - 0.1, high=lost + 0.1)
    found = verdicts(replace(FINDINGS, withdrawn=(replace(LOSS, share=share), 90.0)))
    [refuted] = [one for one in found if one.evidence]
    assert (refuted.actuator, refuted.condition, refuted.worst) == (f"motor {LOSS.motor}", "normal", worst)
    assert (refuted.evidence[0].start_s, refuted.evidence[0].end_s) == (round(LOSS.since_s, 2), 90.0)


def test_what_was_found_never_falls_where_another_motor_shows_a_loss() -> None:
    [found] = verdicts(replace(FINDINGS, several=(1, 3), loss=LOSS))
    assert (found.actuator, found.condition, found.worst) == ("motors 1 and 3", "emergency", "emergency")
    assert found.since is not None
    assert found.evidence


FLIGHTS = 5


def compared(
    trims: list[float],
    yaw: float = 0.0,
    *,
    between: float = 0.03,
    condition: Condition = "normal",
    evidence: tuple[Evidence, ...] = (),
) -> list[Verdict]:
    flown = [
        verdict(
            condition,
            subject="motor",
            actuator=f"motor {k}",
            coverage=Coverage(moving_fraction=1.0, windows=100, decidable=100),
            indicators=(indicator(TRIM, 0.05 + value), indicator(TRIM_YAW, 0.01 + yaw)),
            evidence=evidence,
            reason="as it was",
        )
        for k, value in enumerate(trims, 1)
    ]
    known = {
        TRIM: Baseline(mean=0.05, error=0.01, flights=FLIGHTS, between=between, spread=0.03),
        TRIM_YAW: Baseline(mean=0.01, error=0.01, flights=FLIGHTS, between=0.02, spread=0.01),
    }
    return compare_motors(flown, lambda _: known, start_utc=START, end_s=100.0)


def test_the_motor_with_the_largest_change_is_worn_if_it_is_certain() -> None:
    """The scatter between flights is that of others, worth ten flights, and the aircraft's own."""
    for between, least in ((0.0, 0.15), (0.2, 0.4316)):
        for share, worn in ((1.001, True), (0.999, False)):
            found = compared([0.0, share * least, 0.5 * least, -2.0 * least], between=between)
            expected = ["normal", "degraded" if worn else "normal", "normal", "normal"]
            assert [one.condition for one in found] == expected
            assert all(one.indicators[0].baseline_flights == FLIGHTS for one in found)
    worn_one = compared([0.0, 0.4, 0.1, 0.0])[1]
    [evidence] = worn_one.evidence
    assert (evidence.value, evidence.limit, evidence.start_s, evidence.end_s) == (0.4, 0.15, 0.0, 100.0)
    assert evidence.rule.startswith("degraded: is asked for 40 % more thrust beside the others than in 5 ")
    assert (worn_one.worst, worn_one.reason, worn_one.suspects[0].fault) == ("degraded", None, "thrust")
    assert worn_one.suspects[0].confidence == 0.99
    assert present(worn_one.since).utc == START.isoformat()


@pytest.mark.parametrize(("yaw", "weight"), [(0.054, True), (0.057, False)])
def test_only_yaw_separates_a_motor_from_a_weight(yaw: float, weight: bool) -> None:
    [evidence] = compared([0.4, 0.0, 0.0, 0.0], yaw)[0].evidence
    assert ("a weight that sits elsewhere" in evidence.rule) is weight


def test_a_loss_in_flight_keeps_its_verdict() -> None:
    found = compared([0.4, 0.0, 0.0, 0.0], condition="degraded")
    assert [one.evidence for one in found] == [()] * 4
    assert found[0].reason == "as it was"


def test_wear_from_the_start_on_makes_a_loss_in_flight_no_milder() -> None:
    lost = Evidence(kind="thrust", start_s=40.0, end_s=90.0, value=0.6, limit=0.5, rule="emergency: lost")
    found = compared([0.4, 0.0, 0.0, 0.0], condition="emergency", evidence=(lost,))[0]
    assert (found.condition, found.worst) == ("emergency", "emergency")
    assert (found.since, found.reason) == (None, "as it was")
    assert [item.condition for item in found.evidence] == ["degraded", "emergency"]
