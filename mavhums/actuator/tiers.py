"""Telemetry tiers: what a log can carry of an actuator, and what it takes to carry more."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

__all__ = ["TIERS", "Tier", "best_tier"]


@dataclass(frozen=True, slots=True)
class Tier:
    """One way in which a log carries actuator telemetry.

    Attributes
    ----------
    messages
        MAVLink messages, one of which marks the tier.
    gives
        Which quantities it gives.
    judged
        Whether health can be judged from it.
    """

    name: str
    messages: frozenset[str]
    gives: str
    judged: bool


TIERS = (
    Tier("instrumented", frozenset({"DEBUG_FLOAT_ARRAY"}), "V1–V12", True),
    Tier(
        "esc-unsigned",
        frozenset({"ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "ESC_TELEMETRY_9_TO_12"}),
        "magnitudes of V4, V5, V7",
        False,
    ),
    Tier("pwm", frozenset({"SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS"}), "V1", False),
)


def best_tier(messages: Collection[str], *, instrumented: bool) -> Tier | None:
    """Return the richest tier that a vehicle's messages allow, None if they carry nothing.

    ``instrumented`` says whether a DEBUG_FLOAT_ARRAY named "EMA" was among them: others use
    that message, too.

    Examples
    --------
    >>> best_tier({"HEARTBEAT", "SERVO_OUTPUT_RAW"}, instrumented=False).name
    'pwm'
    """
    for tier in TIERS:
        if tier.name == "instrumented":
            if instrumented:
                return tier
        elif tier.messages & set(messages):
            return tier
    return None
