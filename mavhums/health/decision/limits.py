"""A quantity against its limits, by a sequential test over the starts of a fault.

For each of the latest windows, a fault may have begun with it: the mean of the windows since then is compared
with the limit by the likelihood ratio of Student's t, whose error falls with the seconds that the windows
cover, since windows that slide share samples. The largest of these ratios is the evidence of a fault. A fault
ends, and a flight is normal, once windows since some start make health 20 times likelier. A fault is an
emergency unless its latest windows make a value below that limit as much likelier, and no longer one when
that is as certain as an alarm.

A quantity without an error passes a limit or does not: so many seconds that agree are certain.

References
----------
T. L. Lai, "Information bounds and quick detection of parameter changes in stochastic systems", IEEE
Transactions on Information Theory 44, 1998: the window-limited test of generalised likelihood ratios.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import t_quantile
from mavhums.health.decision.thresholds import MOST_FLIGHT_TAIL, STARTS
from mavhums.health.estimation.thresholds import LEAST_PARTS, WINDOW_S
from mavhums.health.sequential import EXCLUDING, PER_100_H, threshold

_WINDOWS: Final = np.arange(1.0, STARTS + 1.0)
# Time through which the windows of a quantity without an error must agree, for a glitch lasts less: a window
# and the least number of slots. Half a slot less, so that rounding does not decide.
_AGREEING_S: Final = WINDOW_S + LEAST_PARTS - 0.5

MOST_CONFIDENCE: Final = 1.0 - MOST_FLIGHT_TAIL
"""Largest confidence that is shown: the tests allow false alarms, and a model may be wrong."""


class Estimates(NamedTuple):
    """Estimates of a quantity in k windows; arrays of shape (k,), NaN for windows without evidence.

    Attributes
    ----------
    value, error
        Estimate and standard error.
    freedom
        Degrees of freedom of the error.
    """

    value: Array
    error: Array
    freedom: Array

    @classmethod
    def of(cls, value: Array, error: Array, freedom: Array, shown: Flags) -> Estimates:
        """Return estimates that are NaN where they are not shown."""
        return cls(np.where(shown, value, np.nan), error, freedom)

    def at(self, which: Flags | Integers) -> Estimates:
        """Return a subset of the windows."""
        return Estimates(*(array[which] for array in self))


def tail_of(false_alarms: float) -> float:
    """Return the allowed false-alarm probability of one 10 s window, given the alarms per 100 hours."""
    return false_alarms / (PER_100_H / WINDOW_S)


def tail_of_flight(false_alarms: float, seconds: float) -> float:
    """Return the allowed false-alarm probability of a comparison that rests on so many seconds of flight.

    The rate is per hour: a longer flight may use more of it, up to a hundredth.
    """
    return min(tail_of(false_alarms) * max(seconds / WINDOW_S, 1.0), MOST_FLIGHT_TAIL)


def half_width(estimates: Estimates, *, tail: float) -> Array:
    """Return half the width of intervals with this tail probability on either side, shape (k,).

    Few degrees of freedom make heavy tails.
    """
    return np.asarray(t_quantile(estimates.freedom, 1.0 - tail) * estimates.error)


class Levels(NamedTuple):
    """The quantity's upper limit for normal and lower limit for an emergency; None if there is none."""

    normal: float | None = None
    emergency: float | None = None


class LimitTest:
    """Decides the condition of one quantity of one actuator through the flight.

    Parameters
    ----------
    levels
        Limits of the quantity.
    false_alarms
        Accepted number of false alarms in 100 hours.
    span_s
        Time through which a fault lasts that one window proves; None if no window proves one.

    Attributes
    ----------
    condition
        The current condition.
    since_s
        Flight time of its onset: the middle of the first window that speaks for it; for the first condition
        of a flight, and for a fault that one window proves, that window's start.
    """

    def __init__(self, levels: Levels, false_alarms: float, span_s: float | None = None) -> None:
        self.condition: Condition = "undecided"
        self.since_s: float | None = None
        self._limits = np.array(levels, dtype=np.float64)  # NaN where there is none
        self._tested = self._limits[: 1 if levels.emergency is None else 2]
        self._tail = tail_of(false_alarms)
        self._alarm = threshold(false_alarms)
        self._span_s = span_s
        # Of each window: weight, weighted excess over each limit, share of its time that the one before
        # did not have.
        self._before = np.zeros((STARTS - 1, 2 + self._tested.size))
        self._last_s = -inf
        self._latest = 0  # number of windows by which a fault is grave or not
        self._ends_s: deque[float] = deque(maxlen=STARTS)
        self._starts = 0  # number of the latest windows with which the present state may have begun

    def evidence(self, estimates: Estimates, end_s: Array) -> Array:
        """Return how much likelier the latest n windows make values above each limit, shape (k, 1 or 2, n).

        The second limit is the emergency's, where there is one. They are logarithms, negative where values
        below are likelier; those before the flight's first window mean nothing.
        """
        value, error, freedom = (column[:, None] for column in estimates)
        exact = error == 0.0
        # Of a value without an error one glitch must not decide; the error of others averages glitches.
        self._latest = WINDOW_S if exact.all() else WINDOW_S // 2
        excess = value - self._tested
        weight = np.where(exact, 1.0, error) ** -2.0
        share = np.minimum(np.diff(end_s, prepend=self._last_s) / WINDOW_S, 1.0)[:, None]
        windows = np.vstack(
            [self._before, np.hstack([weight, weight * np.where(exact, np.sign(excess), excess), share])]
        )
        self._before, self._last_s = windows[1 - STARTS :], float(end_s[-1])
        latest = np.lib.stride_tricks.sliding_window_view(windows, STARTS, axis=0)[:, :, ::-1]
        sums = latest.cumsum(axis=2)
        # The first window counts in full, each later one by what it adds.
        covered = 1.0 + sums[:, -1:] - latest[:, -1:]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = sums[:, 1:-1] / sums[:, :1]
            squared = mean**2 * sums[:, :1] / _WINDOWS * covered
        freedom = freedom[:, :, None] * covered
        ratio: Array = np.sign(mean) * (freedom + 1.0) / 2.0 * np.log1p(squared / freedom)
        if not exact.any():
            return ratio
        sure = np.where(mean > 0.0, self._alarm, EXCLUDING) * WINDOW_S / _AGREEING_S
        return np.asarray(np.where(exact[:, :, None], mean * covered * sure, ratio))

    def feed(self, end_s: float, evidence: Array) -> bool:
        """Take the evidence of the window that ends then, as above; return whether the condition changes."""
        self._ends_s.append(end_s)
        self._starts = min(self._starts + 1, STARTS)
        above, grave = evidence[0, : self._starts], evidence[-1, : self._starts]
        after, first = self.condition, 0
        faulty = SEVERITY[after] > SEVERITY["normal"]
        if faulty and above[ends := int(above.argmin())] <= -EXCLUDING:
            after, first, self._starts = "normal", ends, ends + 1
        elif faulty:
            after = self._fault(grave)
            first = int((grave if after == "emergency" else -grave).argmax())
        elif above[begins := int(above.argmax())] >= self._alarm or (self._span_s and above[0] > 0.0):
            self._starts = begins + 1
            after, first = self._fault(grave), begins
        elif after == "undecided" and above[ends := int(above.argmin())] <= -EXCLUDING:
            after, first = "normal", ends
        if after == self.condition:
            return False
        throughout = self.condition == "undecided" or (self._span_s and after != "normal")
        since_s = self._ends_s[-1 - first] - (self._span_s or WINDOW_S) * (1.0 if throughout else 0.5)
        # Conditions follow each other in time.
        return self._change(after, max(since_s, self.since_s or 0.0))

    def settle(self, flight: Estimates, start_s: float) -> bool:
        """Take the estimate of the whole flight, shape (1,); return whether it decides the condition.

        It counts as one more window that finds a fault, or shows the first health, and never ends a fault.
        """
        low, high = self._interval(flight)
        normal, emergency = self._limits
        after = self.condition
        if SEVERITY[after] > SEVERITY["normal"]:
            return False
        if low > normal:
            after = "emergency" if high >= emergency else "degraded"
        elif low <= normal and not high >= emergency:
            after = "normal"
        return self._change(after, start_s)

    def surely_grave(self, flight: Estimates) -> bool:
        """Return whether the whole interval of the flight, shape (1,), lies beyond the emergency limit."""
        return self._interval(flight)[0] > float(self._limits[1])

    def _interval(self, flight: Estimates) -> tuple[float, float]:
        value, half = float(flight.value[0]), float(half_width(flight, tail=self._tail)[0])
        return value - half, value + half

    def _fault(self, grave: Array) -> Condition:
        """Return the condition of a fault, given the evidence of an emergency by its starts."""
        if self._tested.size == 1:
            return "degraded"
        least = self._alarm if self.condition == "emergency" else EXCLUDING
        return "emergency" if grave[: self._starts][: self._latest][-1] > -least else "degraded"

    def _change(self, after: Condition, since_s: float) -> bool:
        if after == self.condition:
            return False
        self.condition, self.since_s = after, since_s
        return True


class PooledErrors:
    """Pools the errors of a quantity's windows incrementally."""

    def __init__(self) -> None:
        self._sum, self._count = 0.0, 0

    def feed(self, estimates: Estimates) -> Estimates:
        """Return the estimates, shape (k,), with pooled errors and the resulting degrees of freedom."""
        shown = np.isfinite(estimates.value)
        if not shown.size:
            return estimates
        squares = np.where(shown, estimates.error**2, 0.0)
        # The running sums go on from the block before, in the same order of additions.
        running = np.append(self._sum, squares).cumsum()
        total, count = running[1:], self._count + shown.cumsum()
        self._sum, self._count = float(total[-1]), int(count[-1])
        freedom, error = estimates.freedom, estimates.error
        # Windows slide by a slot: only each tenth one is independent. More than some of them would
        # make the error deaf to rougher air.
        before = np.minimum(freedom * (count // WINDOW_S), LEAST_PARTS * (WINDOW_S - 1.0))
        pooled = (freedom * squares + before * total / np.maximum(count, 1)) / (freedom + before)
        return Estimates(estimates.value, np.maximum(error, np.sqrt(pooled)), freedom + before)
