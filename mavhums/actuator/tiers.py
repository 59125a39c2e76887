"""Telemetry tiers: what a log can carry of an actuator, and what it takes to carry more."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from mavhums.actuator.sources import (
    actuator_outputs,
    csrv,
    esc_record,
    esc_signed,
    esc_topic,
    esc_unsigned,
    pwm,
    rcou,
)
from mavhums.actuator.sources.instrumented import is_instrumented
from mavhums.actuator.sources.named import is_named
from mavhums.log import Table

__all__ = ["TIERS", "TO_BE_JUDGED", "Tier", "best_tier", "tier_named", "tiers_by_content"]


@dataclass(frozen=True, slots=True)
class Tier:
    """One way in which a log carries actuator telemetry.

    Attributes
    ----------
    messages
        One of these messages marks the tier.
    gives
        Which quantities it gives.
    judged
        Whether health can be judged from it.
    """

    name: str
    messages: frozenset[str]
    gives: str
    judged: bool


TO_BE_JUDGED = (
    "record each servo's ESC telemetry (voltage, current, speed) beside its command, "
    "or send V1–V12 as DEBUG_FLOAT_ARRAY named EMA"
)
"""How to record a log from which health can be judged."""

TIERS = (
    Tier("instrumented", frozenset(), "V1–V12", True),
    Tier(
        "csrv",
        csrv.MESSAGES,
        "V1, V3, V4, V5, V10 and V11, as far as the servo tells them",
        True,
    ),
    Tier(
        "esc-signed",
        esc_signed.MESSAGES | esc_topic.MESSAGES,
        "V4, V5 and V7 with their signs, where an ESC drives a servo and no propeller",
        True,
    ),
    Tier("named", frozenset(), "the quantities that are named", True),
    Tier(
        "esc-unsigned",
        esc_unsigned.MESSAGES | esc_record.MESSAGES,
        "magnitudes of V4, V5 and V7, where an ESC drives a servo and no propeller",
        True,
    ),
    Tier("pwm", pwm.MESSAGES | rcou.MESSAGES | actuator_outputs.MESSAGES, "V1, the command, alone", False),
)


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
    return next((tier for tier in TIERS if tier.name in marked or tier.messages & set(messages)), None)


def tiers_by_content(tables: Mapping[str, Table]) -> set[tuple[int, str]]:
    """Return (vehicle, tier) for the tiers that only the contents of messages tell."""
    found: set[tuple[int, str]] = set()
    for message, tier, matches in (
        ("DEBUG_FLOAT_ARRAY", "instrumented", is_instrumented),
        ("NAMED_VALUE_FLOAT", "named", is_named),
        ("NVF", "named", is_named),
        ("debug_array", "instrumented", is_instrumented),
        ("debug_key_value", "named", is_named),
    ):
        table = tables.get(message)
        if table is not None:
            found.update((int(vehicle), tier) for vehicle in set(table.system[matches(table)].tolist()))
    return found
