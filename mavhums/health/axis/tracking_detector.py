"""The flown attitude leaves the demanded one, as it does when no surface answers any more.

The limit lies a quarter to a third above the highest value of the healthy development flights.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import ClassVar

from mavhums.health.axis.detector import Seen, Shown
from mavhums.health.axis.persistence import Persistent
from mavhums.health.axis.residual import Residual
from mavhums.health.axis.tracking import PitchTracking, RollTracking

__all__ = ["TrackingDetector"]


class TrackingDetector:
    """A flown attitude that does not follow its demand, about one axis.

    Parameters
    ----------
    axis
        ``roll`` or ``pitch``.
    tracking
        The model of the axis.
    limit
        Deviations from the healthy flight from which it is an emergency.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "tracking": "every surface of the axis, and whether the autopilot was overridden"
    }

    def __init__(self, axis: str, tracking: RollTracking | PitchTracking, limit: float) -> None:
        self._axis = axis
        self._limit = limit
        self._residual = Residual(tracking)
        self._persistent = Persistent(self._limit)

    def feed(self, seen: Seen) -> list[Shown]:
        """Return the seconds in which the attitude is away for certain."""
        shown = []
        for left in self._residual.feed(seen.rows):
            since_s = self._persistent.left(left)
            if since_s is not None:
                rule = (
                    f"emergency: {self._axis} {degrees(left.value):.0f}° away from the demanded one for 3 s"
                )
                shown.append(
                    Shown(
                        self._axis,
                        left.end_s,
                        "tracking",
                        "emergency",
                        since_s,
                        left.deviations,
                        self._limit,
                        rule,
                        0.99,
                    )
                )
        return shown
