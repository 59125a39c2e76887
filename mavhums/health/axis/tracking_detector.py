"""The flown attitude leaves the demanded one, as it does when no surface answers any more.

The limit lies a quarter to a third above the highest value of the healthy development flights.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import ClassVar, Final

import numpy as np

from mavhums.health.axis.detector import Seen, Shown
from mavhums.health.axis.persistence import Persistent
from mavhums.health.axis.residual import Residual
from mavhums.health.axis.tracking import PitchTracking, RollTracking
from mavhums.vehicle.flight import Rows
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["TrackingDetector"]

_SLOW_S: Final = 0.42  # between samples: 2 Hz
_COARSE: Final = 1.5  # times the limit there: a turn begins and ends between two samples


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
    seconds
        Seconds in a row for which the limit must be exceeded.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "tracking": "every surface of the axis, and whether the autopilot was overridden"
    }

    def __init__(self, axis: str, tracking: RollTracking | PitchTracking, limit: float, seconds: int) -> None:
        self._axis = axis
        self._limit = limit
        self._residual = Residual(tracking)
        self._persistent = Persistent(self._limit, seconds)

    def feed(self, seen: Seen) -> list[Shown]:
        """Return the seconds in which the attitude is away for certain."""
        shown = []
        coarse = _coarse(seen.rows)
        for left in self._residual.feed(seen.rows):
            limit = self._limit * (_COARSE if coarse[left.end_s - seen.rows.second - 1] else 1.0)
            since_s = self._persistent.feed(left.end_s, left.deviations * self._limit / limit)
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
                        limit,
                        rule,
                        0.99,
                    )
                )
        return shown


def _coarse(rows: Rows) -> list[bool]:
    """Return of each second whether its samples lie too far apart to follow a turn."""
    spacing = np.nan_to_num(rows.spacing).reshape(-1, RATE_HZ).mean(axis=1)
    return [bool(coarse) for coarse in spacing > _SLOW_S]
