"""Telemetry tiers: the actuator quantities that a log can carry, and how to log more of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mavhums.actuator.sources import SOURCES
from mavhums.actuator.tier import Tier
from mavhums.log import Table

__all__ = ["TIERS", "TO_BE_JUDGED", "Tier", "best_tier", "tier_named", "tiers_by_content"]

TO_BE_JUDGED = (
    "record each servo's ESC telemetry (voltage, current, speed) beside its command, its CSRV "
    "(ArduPilot 4.7, DroneCAN), or V1–V12 as DEBUG_FLOAT_ARRAY named EMA"
)
"""How to record a log from which health can be judged."""

_DESCRIBED = tuple(source for source in SOURCES if hasattr(source, "TIER"))

TIERS: tuple[Tier, ...] = tuple(dict.fromkeys(source.TIER for source in _DESCRIBED))
"""The tiers, the richest first."""

_MARKED_BY_NAME = tuple((s.MESSAGES, s.TIER) for s in _DESCRIBED if not hasattr(s, "is_marked"))
_MARKED_BY_CONTENT = tuple((s.MESSAGES, s.TIER, s.is_marked) for s in _DESCRIBED if hasattr(s, "is_marked"))


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

    ``marked`` names tiers that were recognised by what messages contain: a DEBUG_FLOAT_ARRAY
    counts only if it is named EMA, a NAMED_VALUE_FLOAT only if its name is a quantity's.

    Examples
    --------
    >>> best_tier({"HEARTBEAT", "SERVO_OUTPUT_RAW"}).name
    'pwm'
    """
    carried = {tier.name for names, tier in _MARKED_BY_NAME if names & set(messages)}
    return next((tier for tier in TIERS if tier.name in carried or tier.name in marked), None)


def tiers_by_content(tables: Mapping[str, Table]) -> set[tuple[int, str]]:
    """Return (vehicle, tier) for the tiers that only the contents of messages identify."""
    found: set[tuple[int, str]] = set()
    for messages, tier, is_marked in _MARKED_BY_CONTENT:
        for message in messages & tables.keys():
            table = tables[message]
            found.update(
                (int(vehicle), tier.name) for vehicle in set(table.system[is_marked(table)].tolist())
            )
    return found
