"""Roll: the flown attitude leaves the demanded one."""

from __future__ import annotations

from typing import ClassVar

from mavhums.health.axis.detector import Limits
from mavhums.health.axis.tracking import RollTracking
from mavhums.health.axis.tracking_detector import TrackingDetector

__all__ = ["Detector"]


class Detector(TrackingDetector):
    """A roll angle that does not follow its demand."""

    axes: ClassVar[tuple[str, ...]] = ("roll",)

    def __init__(self, limits: Limits) -> None:
        super().__init__("roll", RollTracking(), limits.roll_tracking)
