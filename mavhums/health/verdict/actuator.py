"""Conversion of an actuator's findings to a verdict, or to a reason and a remedy if there are none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from mavhums.actuator.derive import SIGNED_BY_VOLTAGE
from mavhums.actuator.freshness import not_used
from mavhums.actuator.profile import FILL_IN, Actuator
from mavhums.actuator.telemetry import TO_BE_JUDGED, Tier
from mavhums.core.conditions import Condition
from mavhums.health.actuator.thresholds import IMPLAUSIBLE_SHARE
from mavhums.health.decision.conditions import since
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.verdict.obstacles import WEAR_UNSEEN, obstacle
from mavhums.results.sections import NetworkAnswer
from mavhums.results.standing import Interval
from mavhums.results.verdict import ALL, Coverage, Evidence, Indicator, Suspect, Verdict
from mavhums.vehicle.formats import remedy as to_record
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.surfaces import Surfaces

if TYPE_CHECKING:
    from mavhums.health.actuator.monitor import ActuatorFindings


class BaselineFindings(NamedTuple):
    """Findings about an actuator in comparison with its own baseline, unrounded.

    ``baselines`` are by fault; ``decidable`` is the number of windows that show what left its baseline. The
    other fields are those of :class:`mavhums.health.actuator.monitor.ActuatorFindings`.
    """

    condition: Condition
    worst: Condition
    since_s: float | None
    suspects: tuple[Suspect, ...]
    evidence: tuple[Evidence, ...]
    baselines: Mapping[str, Interval]
    last_s: float
    decidable: int


def verdict_of_actuator(
    vehicle: int,
    actuator: Actuator,
    findings: ActuatorFindings,
    *,
    start_utc: datetime,
    end_s: float,
    late: int,
    implausible: Mapping[str, tuple[int, int]],
    provenance: dict[str, str],
    tier: Tier,
    network: NetworkAnswer | None = None,
) -> Verdict:
    """Return the verdict on an actuator with telemetry.

    If its telemetry ended more than a window before the log's end ``end_s``, its condition is undecided:
    silence is never normal. Earlier findings remain. ``implausible`` is, by quantity, the number of
    implausible values and the number of all values.
    """
    silent = _is_silent(findings.last_s, end_s)
    # Silence is never normal; earlier findings stay as the worst.
    condition: Condition = "undecided" if silent else findings.condition
    reason, remedy = None, None
    if findings.condition == "undecided":
        reason, remedy = _absurd(implausible) or _why_undecided(actuator, findings, provenance)
    elif silent:
        reason, remedy = _silence(findings.last_s, end_s, findings.condition)
    return Verdict(
        vehicle=vehicle,
        actuator=actuator.name,
        condition=condition,
        worst=findings.worst,
        network=network,
        friction_nm=rounded(findings.friction),
        suspects=rounded_suspects(findings.suspects),
        since=since(None if silent else findings.since_s, start_utc),
        coverage=Coverage(
            moving_fraction=round(findings.coverage.moving_fraction, 4),
            windows=findings.coverage.windows,
            decidable=findings.coverage.decidable,
            late=findings.coverage.late + late,
            implausible={key: refused for key, (refused, _) in implausible.items()},
        ),
        tier=tier.name,
        provenance=provenance,
        evidence=tuple(_rounded_evidence(evidence) for evidence in findings.evidence),
        indicators=tuple(_rounded_indicator(indicator) for indicator in findings.indicators),
        own=() if silent else findings.own,
        reason=reason,
        remedy=remedy,
    )


def against_baseline(
    verdict: Verdict, found: BaselineFindings, *, start_utc: datetime, end_s: float
) -> Verdict:
    """Return a verdict on a flight alone, updated by the comparison with the actuator's own baseline.

    ``end_s`` is the end of the log, in flight time.
    """
    silent = _is_silent(found.last_s, end_s)
    decidable = max(verdict.coverage.decidable, found.decidable)
    reason, remedy = verdict.reason, verdict.remedy
    if found.condition != "undecided":
        reason, remedy = _silence(found.last_s, end_s, found.condition) if silent else (None, None)
    return verdict.model_copy(
        update={
            "condition": "undecided" if silent else found.condition,
            "worst": found.worst,
            "suspects": rounded_suspects(found.suspects),
            "coverage": verdict.coverage.model_copy(update={"decidable": decidable}),
            "since": since(None if silent else found.since_s, start_utc),
            "evidence": tuple(_rounded_evidence(evidence) for evidence in found.evidence),
            "indicators": tuple(
                _rounded_indicator(one.model_copy(update={"baseline": found.baselines.get(one.fault)}))
                for one in verdict.indicators
            ),
            "reason": reason,
            "remedy": remedy,
        }
    )


def with_refused(verdict: Verdict) -> Verdict:
    """Return an undecided verdict with what the log carries and no equation could use."""
    refused = not_used(verdict.provenance)
    why = "; ".join(refused.values())
    if verdict.condition != "undecided" or (verdict.reason or "").startswith(why):
        return verdict
    return verdict.model_copy(
        update={
            "reason": f"{why}; {verdict.reason}" if verdict.reason else why,
            "remedy": f"record {' and '.join(refused)} as sampled at the motor, with sign",
        }
    )


def unjudged_actuator(
    vehicle: int,
    actuator: Actuator,
    tier: Tier | None,
    provenance: dict[str, str],
    own_gap: str | None = None,
) -> Verdict:
    """Return the verdict on an actuator for which the log or the profile has insufficient data.

    An actuator without feedback is unmonitored, regardless of its profile. ``own_gap`` is the reason why it
    cannot be compared with its own earlier flights either.
    """
    # Absence of telemetry is never an alarm, and never normal.
    if tier is None or not (tier.judged or provenance.keys() - {"V1"}):
        unmonitored = _unmonitored(vehicle, actuator.name, tier, provenance)
        if actuator.travel_deg is not None or "V1" in actuator.fields:
            return unmonitored
        reason = f"{unmonitored.reason}; without travel_deg in the profile its command is no angle"
        return unmonitored.model_copy(update={"reason": reason})
    reasons, remedies = [], []
    if own_gap:
        reasons.append(own_gap)
        remedies.append("record its telemetry faster, or a flight in which the surface works")
    if actuator.blanks:
        no_command = actuator.travel_deg is None and "V1" not in actuator.fields
        travel = ("travel_deg",) if no_command else ()
        reasons.append(f"the profile has no {', no '.join((*actuator.blanks, *travel))}")
        remedies.append(FILL_IN)
    if not (actuator.blanks and tier.judged and provenance):
        reasons.append(_telemetry_gap(actuator, tier))
        remedies.append(TO_BE_JUDGED)
    return unjudged(vehicle, actuator.name, ("; ".join(reasons), "; ".join(remedies)), tier, provenance)


def unjudged(
    vehicle: int | None,
    name: str,
    why: tuple[str, str],
    tier: Tier | None,
    provenance: dict[str, str],
    condition: Condition = "undecided",
) -> Verdict:
    """Return a verdict without findings, such as on an output that moves something else.

    ``why`` is reason and remedy.
    """
    return Verdict(
        vehicle=vehicle,
        actuator=name,
        condition=condition,
        worst=condition,
        tier=tier.name if tier else None,
        provenance=provenance,
        reason=why[0],
        remedy=why[1],
    )


def _telemetry_gap(actuator: Actuator, tier: Tier) -> str:
    if tier.from_esc and actuator.esc is None:
        return f"the profile names no ESC of servo {actuator.servo}: those that report drive propellers"
    return f"the log's {tier.name} telemetry leaves out servo {actuator.servo}"


def unjudged_vehicle(
    vehicle: int | None,
    tier: Tier | None,
    identity: Identity | None = None,
    *,
    surfaces: Surfaces | None = None,
    rotors: Mapping[int, str] = MappingProxyType({}),
) -> Iterator[Verdict]:
    """Yield the verdicts on the actuators of a vehicle without a profile, or on a log without a vehicle.

    If the servos give no feedback, each servo that is known to move a surface, or a helicopter's rotor, is
    unmonitored.
    """
    names = [f"{what} (servo {servo})" for servo, what in rotors.items()]
    if surfaces is not None and (tier is None or not tier.judged):
        names = names or [surfaces.named(moved) for moved in surfaces.moved]
    if vehicle is not None and names:
        yield from (_unmonitored(vehicle, name, tier, {}) for name in names)
        return
    why = obstacle(tier, identity)
    if vehicle is None:
        why = "no vehicle found in this log", "record the link between vehicle and ground station"
    # Absence of telemetry is neither normal nor a gap in the evidence: nothing reports on the servos.
    silent = vehicle is not None and (tier is None or not tier.judged)
    yield unjudged(vehicle, ALL, why, tier, {}, "unmonitored" if silent else "undecided")


def _unmonitored(vehicle: int, name: str, tier: Tier | None, provenance: dict[str, str]) -> Verdict:
    """Return the verdict on an actuator without feedback: neither an alarm nor a normal condition."""
    return unjudged(vehicle, name, (WEAR_UNSEEN, TO_BE_JUDGED), tier, provenance, "unmonitored")


def _absurd(implausible: Mapping[str, tuple[int, int]]) -> tuple[str, str] | None:
    """Return reason and remedy if most values of a quantity are implausible for this actuator."""
    shares = {key: refused / told for key, (refused, told) in implausible.items()}
    worst = [key for key, share in shares.items() if share > IMPLAUSIBLE_SHARE]
    if not worst:
        return None
    share = f"{100 * max(shares.values()):.0f} %"
    return (
        f"up to {share} of the values of {', '.join(worst)} are beyond what the profile's actuator can do",
        "check the unit and scale of these fields, and the profile's constants, travel and voltage",
    )


def crowded_out(vehicle: int, tier: Tier | None, most: int) -> Verdict:
    """Return the verdict on a vehicle beyond the maximum number of judged vehicles."""
    why = (
        f"more than {most} vehicles transmit; this one came after them",
        "record each vehicle's link on its own; on a link, accept only signed frames (--key)",
    )
    return unjudged(vehicle, ALL, why, tier, {})


def _why_undecided(
    actuator: Actuator, findings: ActuatorFindings, provenance: dict[str, str]
) -> tuple[str, str]:
    missing = [] if "V7" in provenance else ["V7"]
    # At the motor the voltage shows the current, at the supply bus it does not.
    shown_by = {"V4", "V5", "V8"} if actuator.esc_side == "motor" else {"V5", "V8"}
    if not shown_by & provenance.keys():
        missing.append("V4, V5 or V8" if actuator.esc_side == "motor" else "V5 or V8")
    if "V6" in provenance and "V5" not in provenance and actuator.esc_side == "bus":
        return (
            "its ESC measures at the supply bus, where driving and braking currents of the motor look alike",
            f"measure at the motor's terminals, or {to_record('motor quantities')}",
        )
    # In the order of what binds: what is not measured, then how long, then how it moved.
    if missing:
        return f"{', '.join(missing)} not measured, so the torque balance cannot be formed", TO_BE_JUDGED
    coverage = findings.coverage
    if coverage.windows == 0:
        return f"less than {WINDOW_S:g} s of telemetry", "record the whole flight"
    if findings.no_friction:
        return findings.no_friction
    if actuator.blanks:
        return f"the profile has no {', no '.join(actuator.blanks)}", FILL_IN
    if coverage.decidable == 0 and provenance.get("V5", "").endswith(SIGNED_BY_VOLTAGE):
        share = f"{100 * coverage.moving_fraction:.0f} %"
        return (
            f"the actuator moves in {share} of the samples, too slowly to show friction: in slow motion the "
            "magnitudes that the ESC sends do not tell a driving current from a braking one",
            f"analyse a flight in which the surface moves faster, or {to_record('signed currents')}",
        )
    return (
        f"{coverage.decidable} of {coverage.windows} windows are decidable, and too few in a row agree",
        "analyse a longer flight",
    )


def _is_silent(last_s: float, end_s: float) -> bool:
    return last_s < end_s - WINDOW_S


def _silence(last_s: float, end_s: float, condition: Condition) -> tuple[str, str]:
    ended = f"its telemetry ends at {last_s:.0f} s of {end_s:.0f} s"
    return f"{ended}, when it was {condition}", "check why it is silent: sensor, wiring or link"


def rounded_suspects(suspects: tuple[Suspect, ...]) -> tuple[Suspect, ...]:
    """Return suspects with the decimals that are shown."""
    return tuple(Suspect(fault=s.fault, confidence=round(s.confidence, 4)) for s in suspects)


def rounded(interval: Interval | None, decimals: int = 4) -> Interval | None:
    """Return an interval with so many decimals; None if there is none."""
    if interval is None:
        return None
    return Interval(**{name: round(number, decimals) for name, number in interval})


def _rounded_indicator(indicator: Indicator) -> Indicator:
    return indicator.model_copy(
        update={
            "value": indicator.value.significant(5),
            "scatter": None if indicator.scatter is None else float(f"{indicator.scatter:.4g}"),
            "baseline": indicator.baseline and indicator.baseline.significant(5),
        }
    )


def _rounded_evidence(evidence: Evidence) -> Evidence:
    return evidence.model_copy(
        update={
            "start_s": round(evidence.start_s, 3),
            "end_s": round(evidence.end_s, 3),
            "value": round(evidence.value, 4),
        }
    )
