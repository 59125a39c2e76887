"""The contents of a log: its senders, their rates, the losses, and the data on the actuators."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from mavhums.actuator.mapping import ActuatorMapper
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.actuator.telemetry import TIERS
from mavhums.core.output import as_utf8
from mavhums.core.quantities import KEYS
from mavhums.engine.engine import Engine
from mavhums.engine.options import EngineOptions
from mavhums.log import Decoder, read_blocks
from mavhums.results.assessment import (
    ActuatorTelemetry,
    Assessment,
    Inspection,
    Judgeable,
    MessageRate,
    NamedRate,
    VehicleTelemetry,
)
from mavhums.results.verdict import ALL, MOTORS, Verdict
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
    assessment = engine.assessment()
    duration_s = assessment.log.duration_s

    def rate_hz(count: int) -> float:
        return round(count / duration_s, 2) if duration_s else 0.0

    return Inspection(
        path=as_utf8(path),
        size_bytes=size,
        start_utc=assessment.log.start_utc,
        duration_s=duration_s,
        vehicles=tuple(_vehicle(vehicle, engine, assessment) for vehicle in assessment.log.vehicles),
        messages=tuple(
            MessageRate(system=system, component=component, name=name, count=count, rate_hz=rate_hz(count))
            for (system, component, name), count in sorted(decoder.counts.items())
        ),
        named=tuple(
            NamedRate(system=system, message=message, name=name, count=count, rate_hz=rate_hz(count))
            for (system, message, name), count in sorted(values.counts.items())
        ),
        unknown_ids=decoder.unknown,
        losses=assessment.log.losses,
    )


def _vehicle(vehicle: int, engine: Engine, assessment: Assessment) -> VehicleTelemetry:
    """Return the known data of a vehicle."""
    identity, mapper, tier = engine.identity(vehicle), engine.mapper(vehicle), engine.tier(vehicle)
    tracks = [mapper.of(vehicle, actuator) for actuator in mapper.airframe.actuators] if mapper else []
    if mapper is not None:
        carried = {track.tier for track in tracks}
        tier = next((tier for tier in TIERS if tier.name in carried), None)
    own = [verdict for verdict in assessment.verdicts if verdict.vehicle == vehicle]
    if all(verdict.subject == "actuator" for verdict in own):
        own += engine.axes(vehicle)
    return VehicleTelemetry(
        vehicle=vehicle,
        kind=identity.kind,
        autopilot=identity.autopilot,
        firmware=identity.firmware,
        board=identity.board,
        airframe=mapper.airframe.name if mapper else None,
        tier=tier.name if tier else None,
        gives=tier.gives if tier else "nothing of the actuators",
        actuators=tuple(map(_telemetry, tracks)),
        subjects=tuple(_judgeable(own)),
        usage=next((used for used in assessment.usage if used.vehicle == vehicle), None),
    )


def _telemetry(track: ActuatorMapper) -> ActuatorTelemetry:
    provenance = track.provenance
    return ActuatorTelemetry(
        actuator=track.actuator.name,
        servo=track.actuator.servo,
        provenance=provenance,
        missing=tuple(key for key in KEYS if key not in provenance),
    )


def _judgeable(verdicts: Sequence[Verdict]) -> Iterator[Judgeable]:
    """Yield what can and cannot be judged of a vehicle: its axes and motors first, then its actuators."""
    found: dict[tuple[str, str], Judgeable] = {}
    for verdict in sorted(verdicts, key=lambda verdict: verdict.subject == "actuator"):
        # What can be judged is the same of each motor, whichever failed.
        name = MOTORS if verdict.subject == "motor" else verdict.actuator
        judged = not {verdict.condition, verdict.worst} <= {"undecided", "unmonitored"}
        one = Judgeable(
            subject=verdict.subject,
            name="every actuator" if name == ALL else name,
            surfaces=verdict.surfaces,
            judgeable=judged,
            reason=None if judged else verdict.reason,
            remedy=None if judged else verdict.remedy,
        )
        found.setdefault((verdict.subject, name), one)
    yield from found.values()
