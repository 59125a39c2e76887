"""One fault, one finding: which axis's finding explains those of the others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

from mavhums.health.axis.thresholds import MASKED_S
from mavhums.results.verdict import Evidence

__all__ = ["origins"]

_ASTRAY: Final = frozenset({"hard_over", "tracking"})


def origins(faulty: Mapping[str, Sequence[Evidence]], mixed: Collection[str]) -> dict[str, str]:
    """Return of each axis whose finding another one explains, that other axis.

    Parameters
    ----------
    faulty
        The evidence of each axis that was degraded or an emergency.
    mixed
        The two axes that mixed surfaces move; none without.
    """
    if len(faulty) < 2:
        return {}
    begun = {axis: min(item.start_s for item in found) for axis, found in faulty.items()}
    first = min(begun, key=lambda axis: begun[axis])
    # A deflected rudder rolls and pitches the aircraft before the side force is certain.
    skids = [item.start_s for item in faulty.get("yaw", ()) if item.kind == "hard_over"]
    if skids and min(skids) <= begun[first] + MASKED_S:
        first = "yaw"
    kinds = {axis: {item.kind for item in found} for axis, found in faulty.items()}
    end_s = max(item.end_s for item in faulty[first])

    def explains(axis: str) -> bool:
        if begun[axis] > end_s + 2 * MASKED_S:
            return False
        # Elevons and V-tails fail about both of their axes, and the ailerons are part of the side force that
        # the rudder is measured against.
        if {first, axis} <= set(mixed) or (first, axis) == ("roll", "yaw"):
            return True
        # A surface that stands deflected upsets every axis; one that lost its effect upsets an attitude at
        # most, and leaves the gain of the others.
        return bool(kinds[first] & _ASTRAY) or kinds[axis] <= _ASTRAY

    return {axis: first for axis in faulty if axis != first and explains(axis)}
