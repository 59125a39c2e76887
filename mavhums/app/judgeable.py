"""Lists what a log allows to judge, subject by subject, in the words of a verdict's reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Final

from mavhums.actuator.contradictions import against_log, remedy
from mavhums.actuator.mapping import Mapper
from mavhums.actuator.tiers import Tier, tier_named
from mavhums.engine.axes import VehicleAxes
from mavhums.health.verdict.actuator import unjudged, unjudged_actuator, unjudged_vehicle
from mavhums.health.verdict.axis import unjudged_axes, verdict_of_axis
from mavhums.health.verdict.obstacles import why_not_at_all
from mavhums.report.assessment import ALL, Verdict
from mavhums.report.inspection import Judgeable
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.surfaces import AXES

__all__ = ["judgeable"]

_UNDATED: Final = datetime(1970, 1, 1, tzinfo=UTC)


def judgeable(
    identity: Identity,
    sent: Tier | None,
    mapper: Mapper | None,
    axes: VehicleAxes | None,
    *,
    rotors: Mapping[int, str] = MappingProxyType({}),
) -> Iterator[Judgeable]:
    """Yield what can and cannot be judged of a vehicle, with reasons: its axes first, then its actuators.

    Parameters
    ----------
    identity
        Identity of the vehicle.
    sent
        Its richest tier of telemetry.
    mapper
        The mapper of its profile; None without one.
    axes
        The axes that followed its flight; None if it reported nothing about its flight.
    rotors
        What the servos of a helicopter's rotors move, by output.
    """
    for verdict in _axes(identity, axes):
        told = {verdict.condition, verdict.worst} != {"undecided"}
        yield _said(verdict, judged=told)
    if mapper is None:
        surfaces = axes.surfaces if axes else None
        for verdict in unjudged_vehicle(identity.vehicle, sent, identity, surfaces=surfaces, rotors=rotors):
            yield _said(verdict, judged=False)
        return
    for actuator in mapper.airframe.actuators:
        name = mapper.tier(identity.vehicle, actuator)
        tier = tier_named(name) if name else None
        provenance = mapper.provenance(identity.vehicle, actuator)
        against = axes.told.last.against(actuator.name) if axes else ()
        if against:
            why = against_log(against), remedy(against)
            yield _said(unjudged(identity.vehicle, actuator.name, why, tier, provenance), judged=False)
            continue
        verdict = unjudged_actuator(identity.vehicle, actuator, tier or sent, provenance)
        yield _said(verdict, judged=tier is not None and tier.judged and not actuator.blanks)


def _axes(identity: Identity, axes: VehicleAxes | None) -> Iterator[Verdict]:
    if axes is None:
        return
    received = axes.grid.received()
    why = why_not_at_all(axes.flight, identity.kind, received)
    if why is not None:
        yield unjudged_axes(identity.vehicle, *why)
        return
    for axis in AXES:
        findings = axes.monitor.findings(axis)
        yield verdict_of_axis(identity.vehicle, findings, axes.surfaces, axes.flight, _UNDATED, received)


def _said(verdict: Verdict, *, judged: bool) -> Judgeable:
    return Judgeable(
        subject=verdict.subject,
        name="every actuator" if verdict.actuator == ALL else verdict.actuator,
        surfaces=verdict.surfaces,
        judgeable=judged,
        reason=None if judged else verdict.reason,
        remedy=None if judged else verdict.remedy,
    )
