"""Which verdicts are listed, in which order, and which are told in one line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mavhums.core.conditions import SEVERITY
from mavhums.health.verdict.obstacles import NO_WINGS, PROPELLERS_ONLY
from mavhums.report.assessment import ALL, Assessment, Verdict
from mavhums.show._words import join, name

__all__ = ["NOT_JUDGED", "heading", "listed", "together", "without_wingless"]

NOT_JUDGED = "not judged (mavhums judges fixed wings, and servos with telemetry)"
"""What is said of a vehicle without wings, after its kind."""

_NAMED = 3  # more names than that push the other columns of a table out of sight


def listed(assessment: Assessment) -> list[Verdict]:
    """Return the verdicts worst first; where nothing is wrong, what is well comes first.

    A verdict that something is wrong must not be overlooked; among others, what could not be judged would
    hide that all that could be judged is well.
    """
    ranked = assessment.ranked()
    if ranked and SEVERITY[ranked[0].gravest] > SEVERITY["normal"]:
        return ranked
    return sorted(ranked, key=lambda verdict: -SEVERITY[verdict.gravest])


def together(verdicts: Sequence[Verdict]) -> Iterator[list[Verdict]]:
    """Yield the verdicts, those on servos without telemetry as one: they differ in nothing but the name."""
    groups: dict[object, list[Verdict]] = {}
    for place, verdict in enumerate(verdicts):
        alike = verdict.condition == verdict.worst == "unmonitored"
        key = (verdict.vehicle, verdict.reason, verdict.remedy) if alike else place
        groups.setdefault(key, []).append(verdict)
    yield from groups.values()


def heading(alike: Sequence[Verdict], assessment: Assessment) -> str:
    """Return what verdicts that are told as one are on: of a servo without telemetry it is the wear alone."""
    many = len(alike) > _NAMED
    names = f"{len(alike)} servos" if many else join(name(verdict, assessment) for verdict in alike)
    unseen = alike[0].gravest == "unmonitored" and alike[0].actuator != ALL
    return f"wear of {names}" if unseen else names


def without_wingless(assessment: Assessment) -> tuple[Assessment, list[str]]:
    """Return an assessment without the vehicles of which nothing is judged, and a line on each of them.

    A copter, a boat, a submarine without telemetry of its servos: neither a reason nor a remedy for each of
    its axes and actuators means anything to its owner.
    """
    by_vehicle: dict[int | None, list[Verdict]] = {}
    for verdict in assessment.verdicts:
        by_vehicle.setdefault(verdict.vehicle, []).append(verdict)
    lines = {vehicle: line for vehicle, own in by_vehicle.items() if (line := _wingless(own))}
    if not lines:
        return assessment, []
    rest = {
        "verdicts": tuple(verdict for verdict in assessment.verdicts if verdict.vehicle not in lines),
        "usage": tuple(usage for usage in assessment.usage if usage.vehicle not in lines),
    }
    several = len(by_vehicle) > 1
    told = [
        f"vehicle {vehicle}: {line}" if several else f"{line[:1].upper()}{line[1:]}"
        for vehicle, line in lines.items()
    ]
    return assessment.model_copy(update=rest), told


def _wingless(own: Sequence[Verdict]) -> str | None:
    """Return what is said of a vehicle without wings and without servos that report; None of any other."""
    axes = next((v for v in own if v.subject == "axis" and v.remedy == NO_WINGS), None)
    servos = [verdict for verdict in own if verdict is not axes]
    if axes is None or any(v.actuator != ALL or not _reports_nothing(v) for v in servos):
        return None
    kind = (axes.reason or "").partition(":")[0]
    return f"{kind}: {NOT_JUDGED}"


def _reports_nothing(verdict: Verdict) -> bool:
    return verdict.condition == "unmonitored" or verdict.remedy == PROPELLERS_ONLY
