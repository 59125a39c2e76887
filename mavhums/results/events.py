"""What happened in a flight: one list, with the kinds in one place."""

from __future__ import annotations

from typing import Final, Literal, get_args

from pydantic import Field

from mavhums.core.models import Contract

EventKind = Literal[
    "crash",
    "impact",
    "altitude_loss",
    "fault",
    "failsafe",
    "reboot",
    "supply",
    "telemetry_ends",
    "contact",
    "errors",
    "begins_in_air",
    "ends_in_air",
    "take_off",
    "landing",
    "armed",
    "disarmed",
    "mode",
]
"""What happened; the kinds that a short answer names first come first."""

IMPORTANCE: Final[tuple[EventKind, ...]] = get_args(EventKind)


class FlightEvent(Contract):
    """Something that happened in a flight.

    ``time_s`` counts from the first record of the log, ``subject`` is what it happened to, where that is not
    the vehicle: an actuator, an ESC. ``said`` is what the vehicle itself named: its mode, its text, a fault.
    ``value`` is the number that decided, in the unit that the kind has: of ``supply`` the voltage below
    which it fell, of ``telemetry_ends`` the seconds for which it was missing in the air, of
    ``altitude_loss`` the metres that it sank below the altitude that its autopilot demanded, of ``impact``
    those that a wing sank in the last four seconds before it came to rest, of ``fault`` how often it was
    reported, of ``errors`` how many the subject counted within the log.
    """

    kind: EventKind
    vehicle: int
    time_s: float = Field(description="Flight time, s.")
    subject: str | None = None
    said: str | None = None
    value: float | None = None
