"""The first reason why a vehicle without a profile has no verdict, and its remedy."""

from __future__ import annotations

from mavhums.actuator.tiers import TO_BE_JUDGED, Tier
from mavhums.vehicle.identity import Identity

__all__ = ["NO_WINGS", "PROPELLERS_ONLY", "WEAR_UNSEEN", "obstacle"]

NO_WINGS = "its servos can be judged if they report current or speed: name a profile with --airframe"
"""Remedy for a vehicle that no control surface turns in flight."""

PROPELLERS_ONLY = "if it moves a surface by a servo after all, name its profile with --airframe"
"""Remedy for a vehicle that flies by its propellers alone."""

WEAR_UNSEEN = "no servo current or speed in the log, so wear cannot be seen"
"""Reason for a servo without telemetry."""

_DRAFT = (
    "name one with --airframe: `mavhums profile new LOG -o mine.toml` drafts it from the log's parameters"
)


def obstacle(tier: Tier | None, identity: Identity | None = None) -> tuple[str, str]:
    """Return reason and remedy for a vehicle without a profile.

    The remedy asks for a profile only if the log carries telemetry that could be judged with one, and never
    for a packaged one: those are of other aircraft, and a log that is of one names it.

    Examples
    --------
    >>> obstacle(None, Identity(1, "quadrotor", multirotor=True))[0]
    'quadrotor: a multirotor has no control surfaces whose servos could be judged'
    """
    who = f"{identity}: " if identity is not None and str(identity) else ""
    if identity is not None and identity.multirotor:
        reason = "a multirotor has no control surfaces whose servos could be judged"
        if tier is not None and tier.from_esc:
            reason += "; its ESC telemetry is that of the propellers"
        return who + reason, PROPELLERS_ONLY
    if tier is None:
        return f"{who}the log carries nothing of the actuators", TO_BE_JUDGED
    if not tier.judged:
        return f"{who}{WEAR_UNSEEN}", TO_BE_JUDGED
    reason = "no airframe profile: one actuator's limits say nothing about another's"
    if tier.from_esc:
        reason += ", and an ESC may drive a propeller: only a profile tells which drives a servo"
    return who + reason, _DRAFT
