"""A skid that lasts beside a roll that goes astray: a rudder's fault that the roll shows first."""

from __future__ import annotations

from math import isnan, nan

from mavhums.health.axis.detectors import Alarm, AxisInput, Persistent
from mavhums.health.axis.thresholds import (
    SHIFT_S,
    SKID_ALONE_DEVIATIONS,
    SKID_M_S2,
    SKID_S,
    SKID_SHARE,
    SKIDDING_DEVIATIONS,
    SURE_CONFIDENCE,
)

__all__ = ["Skids"]


class Skids:
    """Reports a skid that lasts, as with a hard-over rudder; a deflected aileron makes a short one at most.

    No detector of its own: aircraft skid without a fault, too. The monitor takes these alarms beside a roll
    or a pitch that goes astray.
    """

    def __init__(self) -> None:
        self._run = Persistent(1.0, SKID_S)

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which the aircraft skids as no aileron makes it."""
        rolls = {second.end_s: given.shift_deviations("roll", second) for second in given.seconds["roll"]}
        alarms = []
        for end_s, side in given.sides.items():
            roll = rolls.get(end_s, nan)
            # Where the roll is beyond what the regression covers, only a large skid is the rudder's.
            limit = SKID_ALONE_DEVIATIONS if isnan(roll) else max(SKIDDING_DEVIATIONS, SKID_SHARE * roll)
            known = abs(side.value) > SKID_M_S2
            since_s = self._run.feed(end_s, side.deviations / limit if known else 0.0)
            if since_s is not None:
                way = "right" if side.value > 0 else "left"
                rule = (
                    f"emergency: a side force of {abs(side.value):.1f} m/s² to the {way} that no turn "
                    "explains, as if a rudder stood deflected or did not move"
                )
                since_s -= SHIFT_S - 1  # its mean is over as many seconds
                alarms.append(
                    Alarm(
                        "yaw",
                        end_s,
                        "hard_over",
                        "emergency",
                        since_s,
                        side.deviations,
                        limit,
                        rule,
                        SURE_CONFIDENCE,
                    )
                )
        return alarms
