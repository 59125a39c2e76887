"""Converts the findings about a multirotor's motors to verdicts, or to reasons.

A flight alone cannot show a motor or a propeller that was worn from the start. A trim that changed against
the earlier flights is therefore reported with its causes: a worn propeller or motor, or a weight that sits
elsewhere, unless yaw separates them. An imbalance alone is no evidence: whole propellers, a battery beside
the middle and a motor's tolerance make one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import partial
from math import ceil, exp
from types import MappingProxyType
from typing import Final

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import t_quantile
from mavhums.health.decision.baseline import Baseline, ComparedIndicator, with_baselines
from mavhums.health.decision.conditions import since
from mavhums.health.decision.evidence import Departure, with_departures
from mavhums.health.decision.limits import MOST_CONFIDENCE
from mavhums.health.decision.thresholds import MOST_BANK_DEG, MOST_FLIGHT_TAIL, NORMAL_S
from mavhums.health.motor.monitor import TRIM, TRIM_YAW, MotorFindings, ThrustLoss, condition_of
from mavhums.health.motor.speeds import SpeedCause
from mavhums.health.motor.thresholds import (
    BETWEEN_FLIGHTS,
    BOUND_SHARE,
    LEAST_TRIM_CHANGE,
    MOST_EXCLUDED,
    TRIM_SCATTER_PER_MOTOR,
)
from mavhums.health.verdict.obstacles import beside, unjudged, without
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import MOTORS, Coverage, Evidence, Interval, Suspect, Verdict
from mavhums.vehicle.arrivals import Received
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.rotors import Rotors

_NEEDED: Final = {
    "outputs": "the outputs of its motors",
    "attitude": "the attitude",
    "rates": "the body rates",
}


def verdicts_of_motors(
    vehicle: int,
    findings: MotorFindings | None,
    rotors: Rotors | Reason | None,
    flight: Flight,
    start_utc: datetime,
    received: Mapping[str, Received] = MappingProxyType({}),
) -> Iterator[Verdict]:
    """Yield the verdict on the motor that lost thrust, or on each motor of a healthy flight, or one on all.

    Parameters
    ----------
    findings
        What the flight shows; None if the motors are not known.
    rotors
        The motors, or why they are not known.
    flight
        The flight.
    start_utc, received
        Start of the log, and the numbers of samples by message.
    """
    missing = {name: words for name, words in _NEEDED.items() if name not in flight.heard}
    why: tuple[Reason, ...] = ()
    if findings is None:
        why = (rotors if isinstance(rotors, Reason) else Reason("motors_unknown"),)
    elif missing:
        why = without(missing, flight, received)
    elif findings.loss is not None:
        yield _lost(vehicle, findings, findings.loss, start_utc)
    elif findings.tipped:
        why = (Reason("leaned", most_deg=MOST_BANK_DEG),)
    elif findings.judged_s < NORMAL_S:
        judged_s, motion = beside(findings.judged_s, NORMAL_S), "hover" if findings.rotors.lift else "flight"
        why = (Reason("hover_too_short", judged_s=judged_s, motion=motion, needed_s=NORMAL_S),)
    else:
        yield from _healthy(vehicle, findings)
    if why:
        yield unjudged(vehicle, MOTORS, *why, subject="motor")


def _lost(vehicle: int, findings: MotorFindings, loss: ThrustLoss, start_utc: datetime) -> Verdict:
    several, share = findings.several, loss.share
    condition = "emergency" if several else condition_of(share)
    which = f"motor {loss.motor} first " if several else ""
    kept = Interval(
        estimate=round(1 - share.estimate, 3), low=round(1 - share.high, 3), high=round(1 - share.low, 3)
    )
    # In whole per cent, what is lost and what is left make a hundred.
    lost, low, high = (100 - round(100 * left) for left in (kept.estimate, kept.high, kept.low))
    rule = f"{condition}: {which}lost {lost} % of its thrust ({low} to {high} %)"
    return Verdict(
        subject="motor",
        vehicle=vehicle,
        actuator=f"motors {' and '.join(map(str, several))}" if several else f"motor {loss.motor}",
        condition=condition,
        worst=condition,
        effectiveness=kept,
        suspects=(Suspect(fault="thrust", confidence=round(1 / (1 + exp(-loss.odds)), 3)),),
        since=since(loss.since_s, start_utc),
        coverage=_coverage(findings),
        provenance=_origin(findings, loss.motor),
        evidence=(
            Evidence(
                kind="thrust",
                start_s=round(loss.since_s, 2),
                end_s=round(loss.time_s, 2),
                value=round(share.estimate, 3),
                rule=rule,
            ),
            *_by_speed(findings.cause),
        ),
    )


def _by_speed(cause: SpeedCause | None) -> Iterator[Evidence]:
    """Yield what the motor's speed shows of the cause."""
    if cause is not None:
        yield Evidence(
            kind="speed",
            start_s=cause.start_s,
            end_s=cause.end_s,
            value=round(cause.ratio, 3),
            rule=cause.words,
        )


def _healthy(vehicle: int, findings: MotorFindings) -> Iterator[Verdict]:
    """Yield what a flight without a fault excludes, the same for each motor.

    A flight that excludes too little can still be held against earlier ones.
    """
    bound = max(findings.bound)
    condition: Condition = "normal" if bound <= MOST_EXCLUDED else "undecided"
    frame, percent = findings.rotors.frame, ceil(round(100 * bound, 6))
    reason = Reason("motors_normal", frame=frame, bound=percent, share=100 * BOUND_SHARE)
    if condition == "undecided":
        reason = Reason("motors_uncertain", loss=100 * MOST_EXCLUDED)
    for number in range(1, len(findings.bound) + 1):
        worst, evidence = condition, tuple[Evidence]()
        if findings.withdrawn and findings.withdrawn[0].motor == number:
            loss, until_s = findings.withdrawn
            rule = f"lost {100 * loss.share.estimate:.0f} % of its thrust; the flight after refutes it"
            # A motor that stopped may turn again; a propeller that lost a part of its thrust does not heal.
            if condition_of(loss.share) == "emergency":
                worst, rule = "emergency", f"emergency: {rule}"
            evidence = (
                Evidence(
                    kind="thrust",
                    start_s=round(loss.since_s, 2),
                    end_s=until_s,
                    value=round(loss.share.estimate, 3),
                    rule=rule,
                ),
            )
        yield Verdict(
            subject="motor",
            vehicle=vehicle,
            actuator=f"motor {number}",
            condition=condition,
            worst=worst,
            evidence=evidence,
            coverage=_coverage(findings).model_copy(update={"excluded_loss": percent / 100}),
            provenance=_origin(findings, number),
            indicators=findings.indicators[number - 1],
            **said(reason),
        )


def _coverage(findings: MotorFindings) -> Coverage:
    seconds = int(findings.judged_s)
    flown = max(int(findings.flown_s), seconds)
    return Coverage(
        moving_fraction=round(seconds / flown, 4) if flown else 0, windows=flown, decidable=seconds
    )


def _origin(findings: MotorFindings, motor: int) -> dict[str, str]:
    rotors = findings.rotors
    assumed = f"; no parameter gives {rotors.assumed}: the usual is assumed" if rotors.assumed else ""
    return {"V1": f"output {rotors.servos[motor - 1]}, by the log's parameters{assumed}"}


def compare_motors(
    verdicts: Sequence[Verdict],
    baselines: Callable[[Verdict], Mapping[str, Baseline]],
    *,
    start_utc: datetime,
    end_s: float,
) -> list[Verdict]:
    """Return all verdicts of a flight, those on motors after the comparison with earlier flights.

    Parameters
    ----------
    verdicts
        Of all vehicles and kinds.
    baselines
        Returns the baselines of a motor's indicators, by fault.
    start_utc, end_s
        Start of flight time, and the end of the log in flight time.
    """
    compared = list(verdicts)
    for vehicle in {verdict.vehicle for verdict in verdicts if verdict.subject == "motor"}:
        places = [k for k, v in enumerate(compared) if v.subject == "motor" and v.vehicle == vehicle]
        known = {k: baselines(compared[k]) for k in places}
        for k in places:
            compared[k] = with_baselines(compared[k], known[k])
        judged = partial(_judged, start_utc=start_utc, end_s=end_s)
        tail = 1.0 - MOST_FLIGHT_TAIL / len(places)
        scatter = TRIM_SCATTER_PER_MOTOR * len(places)
        trims = {k: found for k in places if (found := _beside(compared[k], known[k], TRIM, scatter))}
        # A motor that carries more unloads the opposite one: the largest is the cause.
        most = max(trims, key=lambda k: trims[k].difference, default=None)
        if most is not None:
            one, yaw = trims[most], _beside(compared[most], known[most], TRIM_YAW, float(BETWEEN_FLIGHTS[2]))
            if one.difference >= LEAST_TRIM_CHANGE and one.ratio > t_quantile(one.freedom, tail):
                compared[most] = judged(compared[most], _of_trim(one, yaw, tail))
    return compared


def _beside(
    verdict: Verdict, baselines: Mapping[str, Baseline], fault: str, scatter: float
) -> ComparedIndicator | None:
    """Return a motor's indicator beside that of earlier flights; others have this scatter between flights."""
    shown = next((one for one in verdict.indicators if one.fault == fault), None)
    known = baselines.get(fault)
    return ComparedIndicator.of(shown, known.pooled(scatter)) if shown and known else None


def _of_trim(one: ComparedIndicator, yaw: ComparedIndicator | None, tail: float) -> Departure:
    cause = "a worn propeller or motor"
    if yaw is None or yaw.ratio < t_quantile(yaw.freedom, tail):
        cause += ", or a weight that sits elsewhere (yaw does not show which)"
    rule = (
        f"degraded: is asked for {100 * one.difference:.0f} % more thrust beside the others than in "
        f"{one.baseline.flights} earlier flights, from the start on: {cause}"
    )
    return Departure("thrust", "degraded", one.difference, LEAST_TRIM_CHANGE, rule, MOST_CONFIDENCE)


def _judged(verdict: Verdict, found: Departure, start_utc: datetime, end_s: float) -> Verdict:
    """Return the verdict with what the earlier flights show; a loss in the flight itself keeps its onset."""
    before = tuple(item for item in verdict.evidence if item.limit is not None)
    if SEVERITY[verdict.condition] > SEVERITY["normal"] and not before:
        return verdict
    changes: dict[str, object] = {}
    if SEVERITY[verdict.condition] < SEVERITY["degraded"]:
        changes = {"condition": "degraded", "since": since(0.0, start_utc), **said()}
    return with_departures(
        verdict.model_copy(update={"evidence": before}), [found], (0.0, end_s), changes=changes
    )
