"""Conversion of an actuator's findings to a verdict, or to its reasons if there are none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple

from mavhums.actuator.derive import SIGNED_BY_VOLTAGE
from mavhums.actuator.plausibility import not_used
from mavhums.actuator.profile import Actuator
from mavhums.actuator.telemetry import TO_BE_JUDGED, Tier
from mavhums.core.conditions import Condition
from mavhums.health.decision.conditions import since
from mavhums.health.decision.thresholds import NAMED_SHARE
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.verdict.obstacles import obstacle, unjudged
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import ALL, Coverage, Evidence, Indicator, Interval, Suspect, Verdict
from mavhums.vehicle.formats import remedy as to_record
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.surfaces import Surfaces

if TYPE_CHECKING:
    from mavhums.health.actuator.monitor import ActuatorFindings


class TelemetrySources(NamedTuple):
    """What a log carries of an actuator.

    Attributes
    ----------
    tier, provenance
        The tier, and the source of each quantity.
    late
        Number of values that came too late or twice.
    implausible
        By quantity, the number of implausible values and the number of all values.
    """

    vehicle: int
    actuator: Actuator
    tier: Tier
    provenance: dict[str, str]
    late: int = 0
    implausible: Mapping[str, tuple[int, int]] = {}


def verdict_of_actuator(
    telemetry: TelemetrySources,
    findings: ActuatorFindings,
    *,
    start_utc: datetime,
    end_s: float,
) -> Verdict:
    """Return the verdict on an actuator with telemetry.

    If its telemetry ended more than a window before the log's end ``end_s``, its condition is undecided:
    silence is never normal. Earlier findings remain.
    """
    vehicle, actuator, tier, provenance, late, implausible = telemetry
    silent = _is_silent(findings.last_s, end_s)
    # Silence is never normal; earlier findings stay as the worst.
    condition: Condition = "undecided" if silent else findings.condition
    reasons: list[Reason] = []
    if findings.condition == "undecided":
        reasons.append(_absurd(implausible) or _why_undecided(actuator, findings, provenance))
    elif silent:
        reasons.append(_silence(findings.last_s, end_s, findings.condition))
    return Verdict(
        vehicle=vehicle,
        actuator=actuator.name,
        condition=condition,
        worst=findings.worst,
        network=findings.network,
        friction_nm=rounded(findings.friction),
        suspects=rounded_suspects(findings.suspects),
        since=since(None if silent else findings.since_s, start_utc),
        coverage=Coverage(
            moving_fraction=round(findings.coverage.moving_fraction, 4),
            windows=findings.coverage.windows,
            decidable=findings.coverage.decidable,
            late=late,
            implausible={key: refused for key, (refused, _) in implausible.items()},
        ),
        tier=tier.name,
        provenance=provenance,
        evidence=tuple(_rounded_evidence(evidence) for evidence in findings.evidence),
        indicators=tuple(_rounded_indicator(indicator) for indicator in findings.indicators),
        own=() if silent else findings.own,
        **said(*reasons),
    )


def with_refused(verdict: Verdict) -> Verdict:
    """Return an undecided verdict with what the log carries and no equation could use."""
    refusal = _refusal(verdict.provenance)
    if verdict.condition != "undecided" or not refusal or "refused" in verdict.reason_codes:
        return verdict
    why = said(*refusal)
    if verdict.reason:
        why["reason"] += f"; {verdict.reason}"
    return verdict.model_copy(update={**why, "reason_codes": ("refused", *verdict.reason_codes)})


def _refusal(provenance: Mapping[str, str]) -> list[Reason]:
    """Return what no equation could use of what the log carries, as one reason; none if there is nothing."""
    why = not_used(provenance)
    return [Reason("refused", why="; ".join(why.values()), quantities=" and ".join(why))] if why else []


def unjudged_actuator(
    vehicle: int,
    actuator: Actuator,
    tier: Tier | None,
    provenance: dict[str, str],
    own_gap: Reason | None = None,
) -> Verdict:
    """Return the verdict on an actuator for which the log or the profile has insufficient data.

    An actuator without feedback is unmonitored, regardless of its profile. ``own_gap`` is the reason why it
    cannot be compared with its own earlier flights either.
    """
    no_angle = actuator.travel_deg is None and "V1" not in actuator.fields
    # Absence of telemetry is never an alarm, and never normal.
    if tier is None or not (tier.judged or provenance.keys() - {"V1"}):
        return _unmonitored(vehicle, actuator.name, tier, provenance, [Reason("no_angle")] * no_angle)
    reasons = [*_refusal(provenance), *filter(None, [own_gap])]
    at_bus = _at_bus(actuator, provenance)
    if at_bus:  # constants would not help
        reasons.append(at_bus)
    elif actuator.blanks:
        travel = ["travel_deg"] * no_angle
        reasons.append(Reason("blanks", blanks=", no ".join((*actuator.blanks, *travel))))
    if not (actuator.blanks and tier.judged and provenance):
        code = "esc_unnamed" if tier.from_esc and actuator.esc is None else "left_out"
        reasons.append(Reason(code, tier=tier.name, servo=actuator.servo, record=TO_BE_JUDGED))
    return unjudged(vehicle, actuator.name, *reasons, tier=tier, provenance=provenance)


def unjudged_vehicle(
    vehicle: int | None,
    tier: Tier | None,
    identity: Identity | None = None,
    surfaces: Surfaces | None = None,
) -> Iterator[Verdict]:
    """Yield the verdicts on the actuators of a vehicle without a profile, or on a log without a vehicle.

    If the servos give no feedback, each servo that is known to move a surface is unmonitored.
    """
    # Absence of telemetry is neither normal nor a gap in the evidence: nothing reports on the servos.
    silent = vehicle is not None and (tier is None or not tier.judged)
    if vehicle is not None and silent and surfaces is not None:
        yield from (_unmonitored(vehicle, surfaces.named(moved), tier, {}) for moved in surfaces.moved)
        return
    why = obstacle(tier, identity) if vehicle is not None else [Reason("no_vehicle")]
    condition: Condition = "unmonitored" if silent else "undecided"
    yield unjudged(vehicle, ALL, *why, condition=condition, tier=tier)


def _unmonitored(
    vehicle: int, name: str, tier: Tier | None, provenance: dict[str, str], more: Sequence[Reason] = ()
) -> Verdict:
    """Return the verdict on an actuator without feedback: neither an alarm nor a normal condition."""
    reasons = Reason("wear_unseen", who="", record=TO_BE_JUDGED), *more
    return unjudged(vehicle, name, *reasons, condition="unmonitored", tier=tier, provenance=provenance)


def _absurd(implausible: Mapping[str, tuple[int, int]]) -> Reason | None:
    """Return the reason if most values of a quantity are implausible for this actuator."""
    shares = {key: refused / count for key, (refused, count) in implausible.items()}
    worst = [key for key, share in shares.items() if share > NAMED_SHARE]
    if not worst:
        return None
    return Reason("implausible", percent=100 * max(shares.values()), quantities=", ".join(worst))


def crowded_out(vehicle: int, tier: Tier | None, most: int) -> Verdict:
    """Return the verdict on a vehicle beyond the maximum number of judged vehicles."""
    return unjudged(vehicle, ALL, Reason("crowded_out", most=most), tier=tier)


def _at_bus(actuator: Actuator, provenance: Mapping[str, str]) -> Reason | None:
    """Return the reason if the power of a supply bus is all that is known of the motor."""
    # Without constants V5 is still the current of the bus.
    motor_current = "V5" in provenance and actuator.ema is not None
    if actuator.esc_side != "bus" or motor_current or not {"V5", "V6"} & provenance.keys():
        return None
    return Reason("bus_power", record=to_record("motor quantities"))


def _why_undecided(actuator: Actuator, findings: ActuatorFindings, provenance: dict[str, str]) -> Reason:
    missing = [] if "V7" in provenance else ["V7"]
    # At the motor the voltage shows the current, at the supply bus it does not.
    shown_by = {"V4", "V5", "V8"} if actuator.esc_side == "motor" else {"V5", "V8"}
    if not shown_by & provenance.keys():
        missing.append("V4, V5 or V8" if actuator.esc_side == "motor" else "V5 or V8")
    if at_bus := _at_bus(actuator, provenance):
        return at_bus
    # In the order of what binds: what is not measured, then how long, then how it moved.
    if missing:
        return Reason("not_measured", quantities=", ".join(missing), record=TO_BE_JUDGED)
    coverage = findings.coverage
    if coverage.windows == 0:
        return Reason("telemetry_too_short", needed_s=WINDOW_S)
    if findings.no_friction:
        return findings.no_friction
    if actuator.blanks:
        return Reason("blanks", blanks=", no ".join(actuator.blanks))
    if coverage.decidable == 0 and provenance.get("V5", "").endswith(SIGNED_BY_VOLTAGE):
        record = to_record("signed currents")
        return Reason("slow_motion", percent=100 * coverage.moving_fraction, record=record)
    return Reason("none_clear", decidable=coverage.decidable, windows=coverage.windows)


def _is_silent(last_s: float, end_s: float) -> bool:
    return last_s < end_s - WINDOW_S


def _silence(last_s: float, end_s: float, condition: Condition) -> Reason:
    return Reason("silent", last_s=last_s, end_s=end_s, condition=condition)


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
            **{
                name: float(f"{value:.5g}")
                for name in ("scatter", "mean", "mean_error")
                if (value := getattr(indicator, name)) is not None
            },
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
