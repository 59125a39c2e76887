"""What a log holds: who speaks, how often, what was lost, and what it tells of the actuators."""

from __future__ import annotations

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from mavhums.actuator.mapping import Mapper, messages_for
from mavhums.actuator.profile import Airframe, load_airframe, packaged_airframes
from mavhums.actuator.tiers import TO_BE_JUDGED, Tier
from mavhums.actuator.vehicle_mappers import VehicleMappers
from mavhums.core.quantities import KEYS
from mavhums.log import Decoder, decode_blocks
from mavhums.log.mavlink.vehicles import vehicles_of
from mavhums.report.inspection import ActuatorTelemetry, Inspection, MessageRate, VehicleTelemetry

__all__ = ["inspect_log"]


def inspect_log(
    path: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    dialect: str | os.PathLike[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Inspection:
    """Read a log and say what it holds, without judging.

    Parameters
    ----------
    path
        A ``.tlog`` file, or ``-`` for the standard input.
    airframe
        A profile, its name or its path; if None, each vehicle's own, if the log names it.
    dialect
        A MAVLink XML file whose definitions go before the shipped ones.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a telemetry log.
    ProfileError
        If the profile cannot be used.
    DialectError
        If the XML cannot be used.
    """
    given = airframe if isinstance(airframe, Airframe) or airframe is None else load_airframe(airframe)
    decoder = Decoder(messages_for(given.actuators if given else ()) | {"STATUSTEXT"}, dialect=dialect)
    fleet = VehicleMappers(given)
    size = 0
    for tables, size, final in decode_blocks(path, decoder, dialect=dialect):
        for _ in (*fleet.listen(tables), *fleet.feed(tables, final=final)):
            pass
        if progress:
            progress(size)
    first, last = decoder.first_time_us, decoder.last_time_us
    duration_s = 0.0 if first is None or last is None else (last - first) / 1e6
    vehicles = vehicles_of(decoder.counts)
    return Inspection(
        path=str(path),
        size_bytes=size,
        start_utc=None
        if first is None or decoder.sender_clock
        else datetime.fromtimestamp(first / 1e6, tz=UTC).isoformat(),
        duration_s=duration_s,
        vehicles=tuple(
            _vehicle(vehicle, fleet.tier(vehicle, decoder.counts), fleet.mapper(vehicle))
            for vehicle in vehicles
        ),
        messages=tuple(
            MessageRate(
                system=system,
                component=component,
                name=name,
                count=count,
                rate_hz=round(count / duration_s, 2) if duration_s else 0.0,
            )
            for (system, component, name), count in sorted(decoder.counts.items())
        ),
        sender_clock=decoder.sender_clock,
        unknown_ids=decoder.unknown,
        losses=decoder.losses,
    )


def _iso(time_us: int) -> str:
    return datetime.fromtimestamp(time_us / 1e6, tz=UTC).isoformat()


def _vehicle(vehicle: int, tier: Tier | None, mapper: Mapper | None) -> VehicleTelemetry:
    rows = []
    for actuator in mapper.airframe.actuators if mapper else ():
        provenance = mapper.provenance(vehicle, actuator) if mapper else {}
        missing = tuple(key for key in KEYS if key not in provenance)
        rows.append(
            ActuatorTelemetry(
                actuator=actuator.name, servo=actuator.servo, provenance=provenance, missing=missing
            )
        )
    airframe = mapper.airframe if mapper else None
    judged = tier is not None and tier.judged
    if not judged:
        remedy = TO_BE_JUDGED
    elif airframe is None:
        known = ", ".join(packaged_airframes())
        remedy = (
            f"name an airframe profile with --airframe (`mavhums profile new LOG` drafts one, or: {known})"
        )
    else:
        remedy = None
    return VehicleTelemetry(
        vehicle=vehicle,
        airframe=airframe.name if airframe else None,
        tier=tier.name if tier else None,
        gives=tier.gives if tier else "nothing of the actuators",
        judged=judged,
        remedy=remedy,
        actuators=tuple(rows),
    )
