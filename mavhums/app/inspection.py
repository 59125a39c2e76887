"""The contents of a log: its senders, their rates, the losses, and the data on the actuators."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from mavhums.actuator.contradictions import Contradiction, against_log
from mavhums.actuator.mapping import ActuatorMapper, Mapper, VehicleMappers, messages_for
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.actuator.telemetry import TIERS, TO_BE_JUDGED, Tier, tier_named
from mavhums.core.output import as_utf8
from mavhums.core.quantities import KEYS
from mavhums.engine.axes import Axes, VehicleLimit, with_drops
from mavhums.engine.usage import vehicle_usage
from mavhums.engine.vehicle_axes import VehicleAxes
from mavhums.health.verdict.actuator import unjudged_actuator, unjudged_vehicle
from mavhums.health.verdict.obstacles import obstacle, unjudged
from mavhums.log import Decoder, decode_blocks
from mavhums.results.assessment import (
    ActuatorTelemetry,
    Inspection,
    Judgeable,
    MessageRate,
    NamedRate,
    VehicleTelemetry,
)
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import ALL, MOTORS, Verdict
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.identity import IDENTITY_MESSAGES, Identities, Identity
from mavhums.vehicle.signals import SIGNAL_MESSAGES
from mavhums.vehicle.states import TEXT_MESSAGES
from mavhums.vehicle.usage import NAMED_MESSAGES, NamedValues
from mavhums.vehicle.vtol import refined_identity

_UNDATED: Final = datetime(1970, 1, 1, tzinfo=UTC)


def inspect_log(
    path: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    dialect: str | os.PathLike[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Inspection:
    """Read a log and return its contents, what it allows to judge, and the use of the servos.

    Parameters
    ----------
    path
        A log of any format, or ``-`` for the standard input.
    airframe
        A profile, its name or its path; if None, each vehicle's own, if the log names it.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a log.
    ProfileError
        If the profile cannot be used.
    DialectError
        If the XML cannot be used.
    """
    given = None if airframe is None else load_airframe(airframe)
    telemetry = messages_for(given.actuators if given else ())
    decoder = Decoder(telemetry | IDENTITY_MESSAGES | SIGNAL_MESSAGES | NAMED_MESSAGES, dialect=dialect)
    fleet, identities, axes, values = VehicleMappers(given), Identities(), Axes(given), NamedValues()
    vehicle_limit, clocks = VehicleLimit(telemetry - TEXT_MESSAGES), Clocks()
    size = 0
    for read, size, final in decode_blocks(path, decoder, dialect=dialect, progress=progress):  # noqa: B007
        identities.feed(read)
        values.feed(read)
        vehicle_limit.observe(read)
        tables = clocks.feed(read, vehicle_limit.admits)
        start_us = decoder.first_time_us or 0
        for text, named in fleet.listen(tables):
            if named is not None:
                axes.announce(text.vehicle, text.frame, named)
        for _ in (
            *fleet.draft(tables),
            *axes.feed(tables, start_us, admits=vehicle_limit.admits, final=final),
            *fleet.feed(tables, final=final),
        ):
            pass
    first, last = decoder.first_time_us, decoder.last_time_us
    duration_s = 0.0 if first is None or last is None else (last - first) / 1e6
    vehicles = decoder.vehicles or identities.vehicles

    def rate_hz(count: int) -> float:
        return round(count / duration_s, 2) if duration_s else 0.0

    return Inspection(
        path=as_utf8(path),
        size_bytes=size,
        start_utc=None
        if first is None or decoder.undated
        else datetime.fromtimestamp(first / 1e6, tz=UTC).isoformat(),
        duration_s=duration_s,
        vehicles=tuple(
            _vehicle(identities.of(vehicle), fleet.tier(vehicle, decoder.counts), fleet.mapper(vehicle), axes)
            for vehicle in vehicles
        ),
        messages=tuple(
            MessageRate(system=system, component=component, name=name, count=count, rate_hz=rate_hz(count))
            for (system, component, name), count in sorted(decoder.counts.items())
        ),
        named=tuple(
            NamedRate(system=system, message=message, name=name, count=count, rate_hz=rate_hz(count))
            for (system, message, name), count in sorted(values.counts.items())
        ),
        sender_clock=decoder.undated,
        unknown_ids=decoder.unknown,
        losses=with_drops(decoder.losses, clocks, axes),
    )


def _vehicle(identity: Identity, sent: Tier | None, mapper: Mapper | None, axes: Axes) -> VehicleTelemetry:
    """Return the known data of a vehicle; ``sent`` is its richest tier, on any of its actuators."""
    vehicle = identity.vehicle
    followed, parameters = axes.vehicle(vehicle), axes.parameters(vehicle)
    identity = refined_identity(identity, parameters.values)
    airframe = mapper.airframe if mapper else None
    tracks = [mapper.of(vehicle, actuator) for actuator in mapper.airframe.actuators] if mapper else []
    own = {track.tier for track in tracks}
    tier = sent if airframe is None else next((tier for tier in TIERS if tier.name in own), None)
    judged = tier is not None and tier.judged and not (airframe is None and identity.multirotor)
    found = followed.setups.last.contradictions if followed else ()
    return VehicleTelemetry(
        vehicle=vehicle,
        kind=identity.kind,
        autopilot=identity.autopilot,
        firmware=identity.firmware,
        board=identity.board,
        airframe=airframe.name if airframe else None,
        tier=tier.name if tier else None,
        gives=tier.gives if tier else "nothing of the actuators",
        judged=judged,
        remedy=_remedy(airframe, tier, sent, identity, found),
        actuators=tuple(map(_telemetry, tracks)),
        subjects=tuple(_judgeable(identity, sent, mapper, followed)),
        usage=vehicle_usage(identity, followed, parameters, airframe) if followed else None,
    )


def _telemetry(track: ActuatorMapper) -> ActuatorTelemetry:
    provenance = track.provenance
    return ActuatorTelemetry(
        actuator=track.actuator.name,
        servo=track.actuator.servo,
        provenance=provenance,
        missing=tuple(key for key in KEYS if key not in provenance),
    )


def _remedy(
    airframe: Airframe | None,
    tier: Tier | None,
    sent: Tier | None,
    identity: Identity,
    found: Sequence[Contradiction],
) -> str | None:
    """Return the obstacle to a verdict and its remedy; None if there is no obstacle."""
    if airframe is None:
        return "{reason}; {remedy}".format(**said(*obstacle(sent, identity)))
    blanks = sorted({blank for actuator in airframe.actuators for blank in actuator.blanks})
    if any(actuator.travel_deg is None and "V1" not in actuator.fields for actuator in airframe.actuators):
        blanks.append("travel_deg, without which a pulse has no angle")
    reasons = [against_log(found)] if found else []
    reasons += [Reason("blanks", blanks=", no ".join(blanks))] if blanks else []
    parts = [f"{one.text}: {one.remedy}" for one in reasons]
    if tier is None or not tier.judged:
        if sent is not None and sent.judged:
            parts.append(f"the log's {sent.name} telemetry is of none of the profile's actuators")
        parts.append(TO_BE_JUDGED)
    return "; ".join(parts) or None


def _judgeable(
    identity: Identity,
    sent: Tier | None,
    mapper: Mapper | None,
    axes: VehicleAxes | None,
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
    """
    motors = False
    for verdict in axes.verdicts(identity, _UNDATED) if axes else ():
        judged = {verdict.condition, verdict.worst} != {"undecided"}
        if verdict.subject != "motor":
            yield _said(verdict, judged=judged)
        elif not motors:
            motors = True
            # What can be judged is the same of each motor, whichever failed.
            yield _said(verdict.model_copy(update={"actuator": MOTORS}), judged=judged)
    if mapper is None:
        surfaces = axes.surfaces if axes else None
        for verdict in unjudged_vehicle(identity.vehicle, sent, identity, surfaces):
            if not motors or "multirotor" not in verdict.reason_codes:
                yield _said(verdict, judged=False)
        return
    for actuator in mapper.airframe.actuators:
        track = mapper.of(identity.vehicle, actuator)
        tier, provenance = tier_named(track.tier) if track.tier else None, track.provenance
        if why := axes.setups.last.against(actuator.name) if axes else None:
            verdict = unjudged(identity.vehicle, actuator.name, why, tier=tier, provenance=provenance)
            yield _said(verdict, judged=False)
            continue
        verdict = unjudged_actuator(identity.vehicle, actuator, tier or sent, provenance)
        yield _said(verdict, judged=tier is not None and tier.judged and not actuator.blanks)


def _said(verdict: Verdict, *, judged: bool) -> Judgeable:
    return Judgeable(
        subject=verdict.subject,
        name="every actuator" if verdict.actuator == ALL else verdict.actuator,
        surfaces=verdict.surfaces,
        judgeable=judged,
        reason=None if judged else verdict.reason,
        remedy=None if judged else verdict.remedy,
    )
