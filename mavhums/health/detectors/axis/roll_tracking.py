"""Roll: the flown attitude leaves the demanded one."""

from __future__ import annotations

from typing import ClassVar, Final

from mavhums.health.axis.tracking import RollTracking
from mavhums.health.axis.tracking_detector import TrackingDetector
from mavhums.report.axis_limits import AxisLimits

__all__ = ["Detector"]

_HELD_S: Final = 3  # a large step of the demand is followed within 2 s


class Detector(TrackingDetector):
    """A roll angle that does not follow its demand."""

    axes: ClassVar[tuple[str, ...]] = ("roll",)

    def __init__(self, limits: AxisLimits) -> None:
        super().__init__("roll", RollTracking(), limits.roll_tracking_deviations, _HELD_S)
