"""Pitch: what the aircraft makes of the demand to the elevators, elevons or V-tail, against the reference.

The limit is 1.8 times the highest level of the healthy development flights. Where the reference lies in a
calm part of a flight in 12 m/s of wind, half a minute of another part keeps as little as 0.53 of it.
"""

from __future__ import annotations

from typing import ClassVar

from mavhums.health.axis.effectiveness import EffectivenessDetector

__all__ = ["Detector"]


class Detector(EffectivenessDetector):
    """A loss of effectiveness about the pitch axis."""

    axis: ClassVar[str] = "pitch"
    limit: ClassVar[float] = 12.0
    common: ClassVar[float] = 0.5
    axes: ClassVar[tuple[str, ...]] = ("pitch",)
