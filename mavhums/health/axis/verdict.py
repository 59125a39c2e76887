"""Converts an axis's findings to a verdict, or to a reason and a remedy if there are none."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from types import MappingProxyType
from typing import Final

from mavhums.health.axis.indicators import indicators
from mavhums.health.axis.monitor import AxisFindings
from mavhums.health.axis.obstacles import why_undecided
from mavhums.report.assessment import Interval, Since, Suspect, Verdict
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.grid import Received
from mavhums.vehicle.surfaces import Surfaces

__all__ = ["judged_axis", "unjudged_axes"]

_BEGINS_IN_FLIGHT: Final = (
    "the log begins in flight: normal is what it was then, and nothing tells whether that was healthy",
    "record from before take-off, or compare with earlier flights (--history)",
)


def unjudged_axes(vehicle: int, reason: str, remedy: str) -> Verdict:
    """Return the single verdict on all axes of a vehicle if none can be judged."""
    return Verdict(
        subject="axis",
        vehicle=vehicle,
        actuator="axes",
        condition="undecided",
        worst="undecided",
        reason=reason,
        remedy=remedy,
    )


def judged_axis(
    vehicle: int,
    findings: AxisFindings,
    surfaces: Surfaces | None,
    flight: Flight,
    start_utc: datetime,
    received: Mapping[str, Received] = MappingProxyType({}),
) -> Verdict:
    """Return the verdict on one axis of a vehicle that flew, with the numbers of samples by message."""
    reason, remedy = None, None
    if findings.condition == "undecided":
        reason, remedy = why_undecided(findings, surfaces, flight, received)
    elif findings.condition == "normal" and not findings.from_take_off:
        reason, remedy = _BEGINS_IN_FLIGHT
    axis = findings.axis
    refused = surfaces is not None and axis in surfaces.contradicted
    origin = {} if surfaces is None else {"V1": f"servo outputs, by {_origin(surfaces, axis)}"}
    coverage = findings.coverage
    late = sum(counts.late for counts in received.values())
    rounded = coverage.model_copy(
        update={"moving_fraction": round(coverage.moving_fraction, 4), "late": late}
    )
    return Verdict(
        subject="axis",
        vehicle=vehicle,
        actuator=findings.axis,
        surfaces=surfaces.names(findings.axis) if surfaces else (),
        condition=findings.condition,
        worst=findings.worst,
        since=_since(findings.since_s, start_utc),
        coverage=rounded,
        suspects=tuple(Suspect(fault=s.fault, confidence=round(s.confidence, 4)) for s in findings.suspects),
        evidence=tuple(e.model_copy(update={"value": round(e.value, 4)}) for e in findings.evidence),
        effectiveness=_rounded(findings.effectiveness),
        limits=findings.limits,
        # Inferred outputs, and those instead of a profile's, have another scale than in other flights.
        indicators=tuple(indicators(findings))
        if surfaces and surfaces.origin != "inferred" and not refused
        else (),
        provenance=origin,
        reason=reason,
        remedy=remedy,
    )


def _origin(surfaces: Surfaces, axis: str) -> str:
    words = {"parameters": "the log's parameters", "profile": "the airframe profile"}
    if axis in surfaces.by_log:
        contradicts = axis in surfaces.contradicted
        return f"{words['parameters']}{', which contradict the airframe profile' if contradicts else ''}"
    return words.get(surfaces.origin, "inference from the flight's beginning")


def _since(since_s: float | None, start_utc: datetime) -> Since | None:
    if since_s is None:
        return None
    utc = start_utc + timedelta(seconds=since_s)
    return Since(flight_time_s=round(since_s, 3), utc=utc.astimezone(UTC).isoformat())


def _rounded(interval: Interval | None) -> Interval | None:
    if interval is None:
        return None
    return Interval(**{name: round(number, 3) for name, number in interval})
