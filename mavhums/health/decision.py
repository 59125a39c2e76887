"""The sequential decision: from a window's friction interval to the actuator's condition.

A window says *normal* unless its whole 95 % interval lies above the normal limit, *emergency* when
the interval reaches the emergency limit, and *degraded* between them. The condition changes when
several decidable windows in a row agree; undecidable windows change nothing.
"""

from __future__ import annotations

from typing import NamedTuple

from mavhums.actuator.profile import Limits
from mavhums.assessment import Condition, Interval

__all__ = ["CONFIRM", "Change", "Decision", "classify", "rule"]

CONFIRM = 5
_SEVERITY: dict[Condition, int] = {"undecided": -1, "normal": 0, "degraded": 1, "emergency": 2}


def classify(friction: Interval, limits: Limits) -> Condition:
    """Return the condition that one friction interval shows.

    Examples
    --------
    >>> classify(Interval(estimate=0.40, low=0.36, high=0.44), Limits(normal=0.375, emergency=0.875))
    'normal'
    """
    if friction.low <= limits.normal:
        return "normal"
    return "emergency" if friction.high >= limits.emergency else "degraded"


def rule(condition: Condition, limits: Limits) -> str:
    """Return in words why friction makes the condition what it is."""
    words = {
        "normal": f"normal: the 95 % interval is not wholly above {limits.normal:g} N·m",
        "degraded": f"degraded: the 95 % interval is wholly above {limits.normal:g} N·m",
        "emergency": f"emergency: the 95 % interval reaches {limits.emergency:g} N·m",
        "undecided": "undecided: no window shows the friction",
    }
    return f"{words[condition]}, {CONFIRM} windows in a row"


class Change(NamedTuple):
    """A change of condition.

    ``since_s`` is the middle of the first window that showed it; for the first condition of a
    flight it is that window's start.
    """

    before: Condition
    after: Condition
    since_s: float
    time_s: float


class Decision:
    """Follows one actuator through the flight.

    Attributes
    ----------
    condition
        What the actuator is held to be now.
    worst
        The worst that it was held to be.
    since_s
        Flight time since which it is in its present condition.
    """

    def __init__(self, limits: Limits) -> None:
        self.condition: Condition = "undecided"
        self.worst: Condition = "undecided"
        self.since_s: float | None = None
        self._limits = limits
        self._candidate: Condition = "undecided"
        self._run = 0
        self._first_s = 0.0

    def feed(self, friction: Interval | None, start_s: float, end_s: float) -> Change | None:
        """Take one window's friction, None if it is undecidable; return the change it brings about."""
        if friction is None:
            return None
        shown = classify(friction, self._limits)
        if shown != self._candidate:
            self._candidate, self._run = shown, 0
            self._first_s = start_s if self.condition == "undecided" else (start_s + end_s) / 2
        self._run += 1
        if shown == self.condition or self._run < CONFIRM:
            return None
        change = Change(self.condition, shown, self._first_s, end_s)
        self.condition, self.since_s = shown, self._first_s
        if _SEVERITY[shown] > _SEVERITY[self.worst]:
            self.worst = shown
        return change
