"""The use of a flight's servos: part of an assessment and of an inspection."""

from __future__ import annotations

from pydantic import Field

from mavhums.core.models import Contract

__all__ = ["OutputUsage", "VehicleUsage"]


class OutputUsage(Contract):
    """How far and how often one servo output was commanded.

    ``commanded`` tells whether it ever moved. Shares are of the calibrated range; they are null where neither
    the log's parameters nor a profile tell that range. The times at the stops and the mean count while the
    vehicle is armed, or where its state is not told. ``bearing_deg`` tells where the motor of a multirotor
    sits, clockwise from the nose; it is null for an output that drives none.
    """

    servo: int
    name: str | None
    named_by: str | None
    commanded: bool
    range_us: tuple[int, int, int] | None
    least_us: int | None
    greatest_us: int | None
    span: float | None = Field(ge=0)
    travelled_us: int = Field(ge=0)
    travelled: float | None = Field(ge=0)
    reversals: int = Field(ge=0)
    held_s: float = Field(ge=0)
    at_low_s: float | None = Field(ge=0)
    at_high_s: float | None = Field(ge=0)
    mean_us: float | None
    bearing_deg: float | None = None


class VehicleUsage(Contract):
    """What a log tells of the use of one vehicle.

    ``armed_s`` is null where the log does not tell whether it is armed, ``forward_s`` counts the seconds in
    forward flight as a fixed wing, of a rover or a boat those of driving forward.
    """

    vehicle: int
    kind: str | None
    firmware: str | None
    armed_s: float | None = Field(ge=0)
    forward_s: float = Field(ge=0)
    outputs: tuple[OutputUsage, ...]
