"""What ``mavhums inspect`` reports of a log."""

from __future__ import annotations

from typing import Literal

from mavhums.core.models import Frozen
from mavhums.log.base.decoder import Losses
from mavhums.results.sections import VehicleUsage

__all__ = ["ActuatorTelemetry", "Inspection", "Judgeable", "MessageRate", "NamedRate", "VehicleTelemetry"]


class MessageRate(Frozen):
    """How often one sender sent one message."""

    system: int
    component: int
    name: str
    count: int
    rate_hz: float


class NamedRate(Frozen):
    """How often one vehicle sent one named value, and in which message."""

    system: int
    message: str
    name: str
    count: int
    rate_hz: float


class ActuatorTelemetry(Frozen):
    """Where each quantity of an actuator comes from; ``missing`` names those that come from nowhere."""

    actuator: str
    servo: int
    provenance: dict[str, str]
    missing: tuple[str, ...]


class Judgeable(Frozen):
    """An axis or an actuator, and whether the log allows to judge it; if not, why and what would."""

    subject: Literal["actuator", "axis", "motor"]
    name: str
    surfaces: tuple[str, ...]
    judgeable: bool
    reason: str | None
    remedy: str | None


class VehicleTelemetry(Frozen):
    """What the log carries of one vehicle's actuators, and how to get more.

    ``kind``, ``autopilot``, ``firmware`` and ``board`` are what the vehicle says of itself. ``tier`` is the
    best of its actuators, or where no profile tells which those are, of the log.
    """

    vehicle: int
    kind: str | None = None
    autopilot: str | None = None
    firmware: str | None = None
    board: str | None = None
    airframe: str | None
    tier: str | None
    gives: str
    judged: bool
    remedy: str | None
    actuators: tuple[ActuatorTelemetry, ...]
    subjects: tuple[Judgeable, ...] = ()
    usage: VehicleUsage | None = None


class Inspection(Frozen):
    """What a log holds.

    ``named`` lists what was sent under names of its own, a thousand of them at most.
    ``sender_clock`` says that the log has no time stamps and that times count from the sender's boot.
    """

    path: str
    size_bytes: int
    start_utc: str | None
    duration_s: float
    vehicles: tuple[VehicleTelemetry, ...]
    messages: tuple[MessageRate, ...]
    named: tuple[NamedRate, ...] = ()
    sender_clock: bool
    unknown_ids: dict[int, int]
    losses: Losses

    def to_json(self, *, indent: int | None = 2) -> str:
        """Return the inspection as JSON."""
        return self.model_dump_json(indent=indent)
