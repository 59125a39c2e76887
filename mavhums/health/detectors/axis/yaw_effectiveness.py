"""Yaw: what the aircraft makes of the demand to the rudders or V-tail, against the reference.

The limit is 1.6 times the highest level of the healthy development flights.
"""

from __future__ import annotations

from typing import ClassVar

from mavhums.health.axis.effectiveness import EffectivenessDetector

__all__ = ["Detector"]


class Detector(EffectivenessDetector):
    """A loss of effectiveness about the yaw axis."""

    axis: ClassVar[str] = "yaw"
    limit: ClassVar[float] = 20.0
    axes: ClassVar[tuple[str, ...]] = ("yaw",)
