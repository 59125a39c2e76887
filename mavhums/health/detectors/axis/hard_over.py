"""A surface that stands deflected: the aircraft rolls otherwise than its ailerons ask, and perhaps skids.

The shift is what the roll regression leaves over three seconds, in standard deviations of the reference.
Where the side force leaves its own reference even further, a rudder stands deflected, not an aileron. The
limit lies a quarter above the highest value of the healthy development flights.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import ClassVar, Final

from mavhums.health.axis.detector import Seen, Shown
from mavhums.health.axis.effectiveness import SHIFT_FLOOR
from mavhums.health.axis.persistence import Persistent
from mavhums.health.axis.residual import Residual
from mavhums.health.axis.tracking import SideForce
from mavhums.report.axis_limits import AxisLimits

__all__ = ["Detector"]

_SKID: Final = 6.0
_SKID_MS2: Final = 1.0


class Detector:
    """A shift of the trim in roll that no demand explains."""

    axes: ClassVar[tuple[str, ...]] = ("roll", "yaw")
    inspect: ClassVar[Mapping[str, str]] = {
        "hard_over": "for a surface that stands deflected: its servo, its linkage, its trim"
    }

    def __init__(self, limits: AxisLimits) -> None:
        self._limit = limits.trim_deviations
        self._side = Residual(SideForce())
        self._persistent = Persistent(self._limit)

    def feed(self, seen: Seen) -> list[Shown]:
        """Return the seconds in which the trim has shifted for certain."""
        sides = {left.end_s: left for left in self._side.feed(seen.rows)}
        reference = seen.gains["roll"].reference
        shown = []
        for second in seen.seconds["roll"]:
            if reference is None or second.shift is None:
                self._persistent.feed(second.end_s, 0.0)
                continue
            deviations = abs(second.shift) / max(reference.deviation, SHIFT_FLOOR)
            since_s = self._persistent.feed(second.end_s, deviations)
            if since_s is None:
                continue
            side = sides.get(second.end_s)
            skids = side is not None and side.deviations > max(_SKID, deviations)
            skids = skids and side is not None and abs(side.value) > _SKID_MS2
            axis, what = ("yaw", "a rudder") if skids else ("roll", "an aileron or elevon")
            way = "right" if second.shift > 0 else "left"
            rule = (
                f"emergency: rolls {way} {degrees(abs(second.shift)):.0f}°/s more than commanded, "
                f"as if {what} stood deflected or did not move"
            )
            shown.append(
                Shown(
                    axis,
                    second.end_s,
                    "hard_over",
                    "emergency",
                    since_s,
                    deviations,
                    self._limit,
                    rule,
                    0.99,
                )
            )
        return shown
