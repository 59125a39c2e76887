"""The contents of a log: its senders, their rates, the losses, and the data on the actuators."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.actuator.telemetry import TIERS
from mavhums.core.output import as_utf8
from mavhums.engine.engine import Engine
from mavhums.engine.options import EngineOptions
from mavhums.log import Decoder, read_blocks
from mavhums.results.assessment import Assessment, Inspection, MessageRate, NamedRate, VehicleTelemetry
from mavhums.vehicle.usage import NAMED_MESSAGES, NamedValues


def inspect_log(
    path: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    dialect: str | os.PathLike[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Inspection:
    """Read a log and return its contents, what it allows to judge, and the use of the servos.

    What can be judged is what the engine judges; a second decoder counts the named values, which it ignores.

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
    engine = Engine(EngineOptions(airframe=given, dialect=dialect))
    decoder, values, size = Decoder(NAMED_MESSAGES, dialect=dialect), NamedValues(), 0
    for block in read_blocks(path, dialect=dialect):
        engine.feed(block)
        values.feed(decoder.feed(block))
        size += len(block)
        if progress:
            progress(size)
    engine.finish()
    values.feed(decoder.feed(b"", final=True))
    assessment = _with_axes(engine.assessment(as_utf8(path)), engine)
    duration_s = assessment.log.duration_s

    def rate_hz(count: int) -> float:
        return round(count / duration_s, 2) if duration_s else 0.0

    return Inspection(
        assessment=assessment,
        size_bytes=size,
        vehicles=tuple(_vehicle(vehicle, engine) for vehicle in assessment.log.vehicles),
        messages=tuple(
            MessageRate(system=system, component=component, name=name, count=count, rate_hz=rate_hz(count))
            for (system, component, name), count in sorted(decoder.counts.items())
        ),
        named=tuple(
            NamedRate(system=system, message=message, name=name, count=count, rate_hz=rate_hz(count))
            for (system, message, name), count in sorted(values.counts.items())
        ),
        unknown_ids=decoder.unknown,
    )


def _with_axes(assessment: Assessment, engine: Engine) -> Assessment:
    """Return an assessment with the verdicts on the axes of every vehicle."""
    shown = {verdict.vehicle for verdict in assessment.verdicts if verdict.subject != "actuator"}
    hidden = [
        one for vehicle in assessment.log.vehicles if vehicle not in shown for one in engine.axes(vehicle)
    ]
    return assessment.model_copy(update={"verdicts": (*assessment.verdicts, *hidden)})


def _vehicle(vehicle: int, engine: Engine) -> VehicleTelemetry:
    """Return what a vehicle reports."""
    identity, mapper, tier = engine.identity(vehicle), engine.mapper(vehicle), engine.tier(vehicle)
    if mapper is not None:
        carried = {mapper.of(vehicle, actuator).tier for actuator in mapper.airframe.actuators}
        tier = next((tier for tier in TIERS if tier.name in carried), None)
    return VehicleTelemetry(
        vehicle=vehicle,
        kind=identity.kind,
        autopilot=identity.autopilot,
        firmware=identity.firmware,
        board=identity.board,
        airframe=mapper.airframe.name if mapper else None,
        tier=tier.name if tier else None,
        gives=tier.gives if tier else "nothing of the actuators",
    )
