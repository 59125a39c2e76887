"""Findings about an axis, and which axis's finding explains those of the others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from mavhums.core.conditions import Condition
from mavhums.health.axis.reference import Reference, Standards
from mavhums.health.axis.response_sums import Response
from mavhums.health.axis.thresholds import MASKED_S
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Interval
from mavhums.results.verdict import Coverage, Evidence, Suspect

__all__ = [
    "origins",
]


@dataclass(frozen=True, slots=True)
class AxisFindings:
    """The findings of a flight about one axis.

    Attributes
    ----------
    reference, best
        The reference used, or else the best candidate; None if there is none.
    usable_s
        Seconds of forward flight in which its demand was known, until the reference.
    effectiveness, windows
        The mean since the last change of the condition, or of a loss the value since its onset, with its
        95 % interval; and the number of windows in the mean, 0 for a loss.
    doubt
        The effectiveness over the last minute, where a loss of 40 % is not excluded by it.
    spacing_s
        Time between samples of the outputs or the rates, where a reference was sought.
    needs
        Requirements on a reference.
    limits
        Limits by which the axis was judged.
    from_take_off
        Whether the flight is known from its take-off on.
    shares
        Of two mixed surfaces that move the axis, the probability that it is the ``left``, the ``right`` or
        ``both``; empty where nothing tells.
    response
        Sums of the flight, for the comparison with other flights; None without any.
    """

    axis: str
    condition: Condition
    worst: Condition
    since_s: float | None
    coverage: Coverage
    suspects: tuple[Suspect, ...]
    evidence: tuple[Evidence, ...]
    effectiveness: Interval | None
    doubt: Interval | None
    windows: int
    reference: Reference | None
    best: Reference | None
    usable_s: int
    spacing_s: float
    needs: Standards
    limits: AxisLimits
    from_take_off: bool
    shares: Mapping[str, float] = field(default_factory=dict)
    response: Response | None = None


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
