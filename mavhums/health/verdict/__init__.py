"""Verdicts: findings in words, with the reason and the remedy where nothing can be said, and the advice.

The advice follows from the gravest condition and from the parts that the suspected fault concerns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from mavhums.core.conditions import Condition
from mavhums.health.axis import detectors as axis_detectors
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import Candidate, Verdict
from mavhums.vehicle.reported import Sag
from mavhums.vehicle.surfaces import STEERING

_BY_CONDITION: Final[dict[Condition, str]] = {
    "normal": "keep the log for the trend over flights",
    "degraded": "inspect {parts} before the next flight, and watch the trend over flights",
    "emergency": "do not fly; inspect {parts}; repair or replace the actuator and test it on the ground",
    "unchanged": "keep the log: later flights are compared with it",
    "changed": "inspect {parts} before the next flight, and watch the trend over flights",
    "learning": "keep the log: the baseline grows with every flight",
    "undecided": "undecided is not healthy: check it by other means, or record what is missing",
    "unmonitored": "unmonitored is not healthy: inspect it as before, or give it telemetry",
}


_RECOVERY_S: Final = 5.0  # after a sag, in which an alarm is still its consequence: a detector's windows last


def with_supply(verdict: Verdict, sags: Sequence[Sag]) -> Verdict:
    """Return a verdict on a surface or an axis, with the servo rail first where a sag explains its alarms.

    A rail feeds every surface: what it does to one is no fault of that one.
    """
    alarms = [one for one in verdict.evidence if one.condition in ("emergency", "degraded")]
    if not alarms or verdict.subject == "motor":
        return verdict
    start_s, end_s = max(one.start_s for one in alarms), min(one.end_s for one in alarms)
    sag = next((sag for sag in sags if start_s <= sag.end_s + _RECOVERY_S and end_s >= sag.start_s), None)
    if sag is None:
        return verdict
    rail = Candidate(surface="servo rail", servo=0, probability=None, because=str(sag))
    return verdict.model_copy(update={"candidates": (rail, *verdict.candidates)})


def of_several_senders(verdict: Verdict, message: str | None) -> Verdict:
    """Return a verdict without findings: its data are of more than one aircraft.

    ``message`` is the one whose time stamps show it; None if nothing does.
    """
    if message is None or verdict.condition == "unmonitored":
        return verdict
    kept = ("subject", "vehicle", "actuator", "surfaces", "tier", "provenance")
    return Verdict(
        condition="undecided",
        worst="undecided",
        **{name: getattr(verdict, name) for name in kept},
        **said(Reason("several_senders", vehicle=verdict.vehicle, message=message)),
    )


def with_advice(verdict: Verdict) -> Verdict:
    """Return a verdict with the recommended action.

    Examples
    --------
    >>> with_advice(Verdict(vehicle=1, actuator="rudder", condition="learning", worst="learning")).advice
    'keep the log: the baseline grows with every flight'
    """
    if verdict.subject == "motor":
        # Outputs alone do not distinguish a propeller from its motor or ESC; the ESC's speed does.
        cause = next((item.rule.rpartition(": ")[2] for item in verdict.evidence if item.kind == "speed"), "")
        before = "motor, ESC and wiring"
        chain = f"propeller, {before}" if not cause else before if "the ESC" in cause else "propeller"
        chain = f"the {chain} of {verdict.actuator}"
        advice = _BY_CONDITION[verdict.gravest].format(parts=chain)
        if verdict.gravest == "emergency":
            advice = f"do not fly; inspect {chain}; replace what failed and test it without propellers"
        return verdict.model_copy(update={"advice": advice})
    if verdict.actuator == STEERING:
        steering = "its servo, linkage and supply, with the wheels off the ground"
        driven = _BY_CONDITION[verdict.gravest].format(parts=steering).replace("flights", "drives")
        return verdict.model_copy(update={"advice": driven.replace("do not fly", "do not drive")})
    suspects = sorted(verdict.suspects, key=lambda suspect: -suspect.confidence)
    # Without a suspect the latest evidence names what was found.
    faults = [suspect.fault for suspect in suspects] or [item.kind for item in reversed(verdict.evidence)]
    parts = next(filter(None, (_parts(verdict, fault) for fault in faults)), "the actuator and its wiring")
    if verdict.consequence_of:
        advice = f"repair what {verdict.consequence_of} control shows, then fly and judge again"
        return verdict.model_copy(update={"advice": advice})
    if verdict.candidates and verdict.candidates[0].because:
        parts = f"{verdict.candidates[0].surface} first, then {parts}"
    advice = _BY_CONDITION[verdict.gravest].format(parts=parts)
    if verdict.subject == "axis" and verdict.gravest == "emergency":
        advice = f"do not fly; inspect {parts}; repair and check the travel of each surface on the ground"
    return verdict.model_copy(update={"advice": advice})


def _parts(verdict: Verdict, fault: str) -> str | None:
    """Return what to inspect for a fault of an axis or an actuator."""
    if verdict.subject == "axis":
        return axis_detectors.to_inspect(fault)
    from mavhums.health.actuator.detectors import to_inspect  # most logs have no telemetry of servos

    return to_inspect(fault)
