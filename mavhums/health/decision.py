"""The sequential decision: from a quantity's windows to the condition that it shows.

A window says *normal* unless its whole interval lies above the normal limit, *emergency* when the interval
reaches the emergency limit, and *degraded* between them; where the interval holds both limits it says
nothing. With an allowed false-alarm probability α for a window of 10 s, that interval is left with √α to
either side. The condition changes when windows in a row agree: as many as two windows that share no sample,
or five if even the interval that is left with α would say so. Windows that say nothing change nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.detector import Estimates, Levels

__all__ = [
    "CONFIRM",
    "FALSE_ALARMS",
    "LASTING",
    "Decision",
    "bounds",
    "half_width",
    "shown_by",
    "tail_of",
]

CONFIRM = 5
LASTING = 20
FALSE_ALARMS = 1.0
"""How many false alarms 100 hours of an actuator may bring, by default."""

_CONDITIONS: dict[int, Condition] = {-1: "undecided", 0: "normal", 1: "degraded", 2: "emergency"}
_WINDOWS_OF_100_H = 36_000.0

Array = NDArray[np.float64]


def tail_of(false_alarms: float) -> float:
    """Return the probability with which one window of 10 s may alarm, given the alarms per 100 hours."""
    return false_alarms / _WINDOWS_OF_100_H


def half_width(estimates: Estimates, *, tail: float | Array) -> Array:
    """Return half the width of intervals that are left to either side with this probability, shape (k,).

    Few degrees of freedom make heavy tails. Several tails, of more dimensions, give as many.
    """
    width: Array = stdtrit(estimates.freedom, 1.0 - tail) * estimates.error
    return width


def bounds(levels: Levels) -> tuple[float, float]:
    """Return the limits as numbers: NaN where nothing is normal, infinity where nothing is an emergency."""
    normal, emergency = levels
    return np.nan if normal is None else normal, np.inf if emergency is None else emergency


def shown_by(low: Array, high: Array, normal: float | Array, emergency: float | Array) -> NDArray[np.int64]:
    """Return the severity that intervals show, -1 for nothing, in the shape of the intervals.

    Examples
    --------
    >>> shown_by(np.array([0.36, 0.40, 0.80, 0.30]), np.array([0.44, 0.48, 0.90, 0.95]), 0.375, 0.875)
    array([ 0,  1,  2, -1])
    """
    reached = high >= emergency
    severity = np.where(low > normal, np.where(reached, 2, 1), np.where(reached, -1, 0))
    return np.where(np.isnan(low) | np.isnan(normal), -1, severity)


class Decision:
    """Follows one quantity of one actuator through the flight.

    Attributes
    ----------
    condition
        What the quantity shows now.
    since_s
        Flight time since which it does: the middle of the first window that showed it; for the first
        condition of a flight that window's start.
    """

    def __init__(self, levels: Levels) -> None:
        self.condition: Condition = "undecided"
        self.since_s: float | None = None
        self.levels = levels
        self._candidate = -1
        self._run = self._sure = 0
        self._first_s = 0.0

    def settle(self, shown: int, start_s: float) -> bool:
        """Take the severity that the whole flight shows; return whether it decides.

        It does where no run of windows could, and where it is a fault and they were normal.
        """
        if shown < 0 or SEVERITY[self.condition] > 0 or _CONDITIONS[shown] == self.condition:
            return False
        self.condition, self.since_s = _CONDITIONS[shown], start_s
        return True

    def feed(self, shown: int, start_s: float, end_s: float, *, sure: bool = True) -> bool:
        """Take the severity that one window shows, and return whether it changes the condition.

        ``sure`` tells whether the wider interval says the same.
        """
        if shown < 0:
            return False
        if shown != self._candidate:
            self._candidate, self._run, self._sure = shown, 0, 0
            self._first_s = start_s if self.condition == "undecided" else (start_s + end_s) / 2
        self._run += 1
        self._sure = self._sure + 1 if sure else 0
        after = _CONDITIONS[shown]
        if after == self.condition or (self._sure < CONFIRM and self._run < LASTING):
            return False
        self.condition, self.since_s = after, self._first_s
        return True
