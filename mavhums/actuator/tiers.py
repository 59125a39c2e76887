"""Telemetry tiers: the actuator quantities that a log can carry, and how to record more of them.

:mod:`mavhums.vehicle.formats` says in which messages a log carries each tier.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from mavhums.log import Table
from mavhums.vehicle.formats import SERVO_SOURCES, remedy

__all__ = ["TIERS", "TO_BE_JUDGED", "Tier", "best_tier", "tier_named", "tiers_by_content"]

TO_BE_JUDGED = remedy("servo telemetry")
"""How to record a log from which health can be judged."""


@dataclass(frozen=True, slots=True)
class Tier:
    """One way in which a log carries actuator telemetry.

    Attributes
    ----------
    gives
        Which quantities it gives.
    judged
        Whether health can be judged from it.
    from_esc
        Whether the messages are those of any ESC, which on most aircraft drives a propeller.
    names_servo
        Whether the messages say of which servo they are, so that no profile need tell.
    """

    name: str
    gives: str
    judged: bool = True
    from_esc: bool = False
    names_servo: bool = False


# In the order of trust: what a servo reports of itself comes before what its ESC does, signed values before
# magnitudes, which need the voltage equation for their signs, and a command says least.
TIERS: tuple[Tier, ...] = (
    Tier("instrumented", "V1–V12", names_servo=True),
    Tier("csrv", "V1, V3, V4, V5, V10 and V11, as far as the servo reports them", names_servo=True),
    Tier(
        "esc-signed",
        "V4, V5 and V7 with their signs, where an ESC drives a servo and no propeller",
        from_esc=True,
    ),
    Tier("named", "the quantities that are named", names_servo=True),
    Tier(
        "esc-unsigned",
        "magnitudes of V4, V5 and V7, where an ESC drives a servo and no propeller",
        from_esc=True,
    ),
    Tier("pwm", "V1, the command, alone", judged=False),
)
"""The tiers, the richest first."""


def tier_named(name: str) -> Tier:
    """Return a tier by its name.

    Examples
    --------
    >>> tier_named("pwm").judged
    False
    """
    return next(tier for tier in TIERS if tier.name == name)


def best_tier(messages: Collection[str], marked: Collection[str] = ()) -> Tier | None:
    """Return the richest tier that a vehicle's messages allow, None if they carry nothing.

    ``marked`` names tiers that were recognised by what messages contain: a debug array or a named value
    counts only if it is named as telemetry of an actuator.

    Examples
    --------
    >>> best_tier({"HEARTBEAT", "SERVO_OUTPUT_RAW"}).name
    'pwm'
    """
    carried = {s.tier for s in SERVO_SOURCES if s.marked is None and s.message in messages}
    return next((tier for tier in TIERS if tier.name in carried or tier.name in marked), None)


def tiers_by_content(tables: Mapping[str, Table]) -> set[tuple[int, str]]:
    """Return (vehicle, tier) for the tiers that only the contents of messages identify."""
    found: set[tuple[int, str]] = set()
    for source in SERVO_SOURCES:
        if source.marked is not None and source.message in tables:
            table = tables[source.message]
            vehicles = set(table.system[source.marked(table)].tolist())
            found.update((int(vehicle), source.tier) for vehicle in vehicles)
    return found
