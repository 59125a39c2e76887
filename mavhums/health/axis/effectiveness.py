"""Detection of a loss of control effectiveness, or of a lag at full gain: shared by the axis detectors."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp
from typing import ClassVar, Final

from mavhums.core.conditions import Condition
from mavhums.health.axis.detector import Seen, Shown
from mavhums.health.axis.gain import JUDGED_ERROR
from mavhums.health.axis.reference import Second
from mavhums.report.axis_limits import AxisLimits

__all__ = ["SHIFT_FLOOR", "EffectivenessDetector"]

_SURE_S: Final = 10
_LEAST_S: Final = 7
_DOUBTFUL: Final = 2.0  # the gain differs between manoeuvres: a single one needs twice the evidence
_SHIFTED: Final = 4.0
SHIFT_FLOOR: Final = 0.045  # rad/s: least deviation of a roll reference


class EffectivenessDetector:
    """Reports an axis whose level exceeds its limit.

    The axis is degraded at once. It is an emergency if the effectiveness over at least ten judged seconds
    is within the limit and no additional lag, as of a slow servo, explains them better.

    Attributes
    ----------
    limit
        Level that makes a loss certain.
    common
        Effectiveness down to which healthy flights go for tens of seconds; above it the limit is doubled.
    """

    axis: ClassVar[str]
    limit: ClassVar[float]
    common: ClassVar[float] = 1.0
    axes: ClassVar[tuple[str, ...]]
    inspect: ClassVar[Mapping[str, str]] = {
        "effectiveness": "each surface of the axis, its linkage and its servo, by moving it on the ground",
        "slow": "each servo of the axis for speed under load, its supply and its linkage for binding",
    }

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits

    def feed(self, seen: Seen) -> list[Shown]:
        """Return the seconds in which a loss is certain."""
        return [self._shown(s) for s in seen.seconds[self.axis] if self._certain(s, seen)]

    def _certain(self, second: Second, seen: Seen) -> bool:
        """Return whether a loss is certain, and not an artefact of a sudden shift of the trim."""
        reference = seen.gains[self.axis].reference
        left = second.left_over if second.left_over is not None else 1.0
        doubtful = second.lost_s < _LEAST_S or (left > self.common and not second.later)
        limit = self.limit * (_DOUBTFUL if doubtful else 1.0)
        if second.level <= limit or reference is None:
            return False
        if second.slow_s is not None and second.slow_s < self._limits.lag_s:
            return False
        if self.axis != "roll" or second.shift is None or second.lost_s >= _LEAST_S:
            return True
        return abs(second.shift) <= _SHIFTED * max(reference.deviation, SHIFT_FLOOR)

    def _shown(self, second: Second) -> Shown:
        left = second.left_over if second.left_over is not None else 1.0
        confidence = 1.0 / (1.0 + exp(-second.level))
        if second.slow_s is not None:
            rule = f"degraded: {_slow(second, second.slow_s, self.axis)}"
            return Shown(
                self.axis,
                second.end_s,
                "slow",
                "degraded",
                second.since_s,
                second.slow_s,
                self._limits.lag_s,
                rule,
                confidence,
            )
        doubt = self._doubt(second) if left <= self._limits.effectiveness_emergency else ""
        grave = left <= self._limits.effectiveness_emergency and not doubt
        condition: Condition = "emergency" if grave else "degraded"
        share = f"{100 * max(left, 0.0):.0f} % of the control effectiveness of the reference is left"
        rule = f"{condition}: {share}{doubt}"
        return Shown(
            self.axis,
            second.end_s,
            "effectiveness",
            condition,
            second.since_s,
            left,
            self._limits.effectiveness_emergency if grave else self._limits.effectiveness_degraded,
            rule,
            confidence,
        )

    def _doubt(self, second: Second) -> str:
        """Return why a loss within the emergency's limit is none yet."""
        if second.later:
            return "; a slow servo explains it nearly as well"
        if second.lost_s < _SURE_S:
            return f"; an emergency if {_SURE_S} judged seconds show it, {second.lost_s} do"
        return ""


def _slow(second: Second, late_s: float, axis: str) -> str:
    """Return what a lag does: the share that is answered in time is no loss of gain."""
    intact = f"gain intact, {late_s:g} s late"
    if second.value is None or second.error > JUDGED_ERROR or not 0 <= second.value < 1:
        return intact
    return f"{100 * second.value:.0f} % of the commanded {axis} is answered in time ({intact})"
