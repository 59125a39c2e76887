"""Pitch: the flown attitude leaves the demanded one."""

from __future__ import annotations

from typing import ClassVar, Final

from mavhums.health.axis.tracking import PitchTracking
from mavhums.health.axis.tracking_detector import TrackingDetector
from mavhums.report.axis_limits import AxisLimits

__all__ = ["Detector"]

_HELD_S: Final = 2


class Detector(TrackingDetector):
    """A pitch angle that does not follow its demand."""

    axes: ClassVar[tuple[str, ...]] = ("pitch",)

    def __init__(self, limits: AxisLimits) -> None:
        super().__init__("pitch", PitchTracking(), limits.pitch_tracking_deviations, _HELD_S)
