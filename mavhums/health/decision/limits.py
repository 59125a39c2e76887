"""A quantity against its limits, by the sequential test.

Health is any value up to the normal limit, the one that a window makes most likely. Faults are values in
intervals above it, whose distance from the limit doubles from one to the next; the emergency limit is a
border between two. A window's likelihood is Student's, with its error and freedom. Of the windows, which
slide by a slot, each tenth shares no sample with the last: they are ten series, and each series and interval
is one hypothesis.

A fault is an emergency unless the probability of a value below the emergency limit is 97.5 % or more, and no
longer one when that is as certain as an alarm. A flight is normal once its windows make health 20 times
likelier than a fault.
"""

from __future__ import annotations

from math import exp, inf, log
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import TAIL_95, t_log_density, t_probability, t_quantile
from mavhums.health.decision.thresholds import (
    EXCESSES,
    MOST_FLIGHT_TAIL,
    MOST_POOLED_FREEDOM,
    WINDOWS_PER_100_H,
)
from mavhums.health.estimation.thresholds import WINDOW_S, WINDOW_SLOTS
from mavhums.health.sequential import EXCLUDING, SequentialTest

_SMALLEST: Final = 1e-300  # probability whose logarithm is finite
_LEAST_ERROR: Final = 1e-9  # share of the limit: a value without an error lies on one side of it


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
    return false_alarms / WINDOWS_PER_100_H


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
        self._span_s = span_s
        self._normal, emergency = (np.nan if level is None else level for level in levels)
        edges = np.append(self._normal * (1.0 + np.array(EXCESSES)), (emergency, 10.0 * emergency))
        self._edges: Array = np.unique(edges[np.isfinite(edges)])
        self._grave: Flags = self._edges[:-1] >= emergency
        cells = max(self._grave.size, 1)
        self._test = SequentialTest(np.ones(WINDOW_SLOTS * cells), false_alarms, cells)
        self._health, self._latest, self._last_s = 0.0, 0.0, -inf
        self._speaks_s = -inf  # end of the first window since which all speak for the same

    def ratios(self, estimates: Estimates) -> Array:
        """Return the logarithms of the likelihood ratios of g intervals to health, shape (k, g)."""
        value, error, freedom = (column[:, None] for column in estimates)
        error = np.maximum(error, _LEAST_ERROR * self._normal)
        borders = (self._edges - value) / error
        low, high = borders[:, :-1], borders[:, 1:]
        # By tails: differences of numbers near one lose their digits.
        tails = t_probability(freedom, -np.abs(borders))
        around = (low < 0.0) & (high > 0.0)
        within = np.where(around, 1.0 - tails[:, :-1] - tails[:, 1:], np.abs(np.diff(tails)))
        healthy = t_log_density(freedom, np.maximum(value - self._normal, 0.0) / error)
        return np.asarray(np.log(np.maximum(within, _SMALLEST) / (high - low)) - healthy)

    def feed(self, end_s: float, ratios: Array) -> bool:
        """Take the ratios of the window that ends then, shape (g,); return whether the condition changes."""
        if not ratios.size:
            return False
        series = np.zeros((WINDOW_SLOTS, ratios.size))
        series[int(end_s) % WINDOW_SLOTS] = ratios
        faulty, after = self._test.alarm, self.condition
        back = float(ratios[self._test.likeliest % ratios.size]) / WINDOW_SLOTS
        self._add_health(end_s, -mean_ratio(ratios))
        if self._test.feed(int(end_s), series.ravel(), back):
            shares = self._test.shares().reshape(series.shape).sum(axis=0)
            after = self._fault(float(shares[self._grave].sum()))
        elif faulty or (after == "undecided" and self._health >= EXCLUDING):
            after = "normal"
        # Conditions follow each other in time.
        return self._change(after, max(self._onset(after, end_s), self.since_s or 0.0))

    def settle(self, ratios: Array, start_s: float, seconds: float) -> bool:
        """Take the ratios of the whole flight, shape (g,); return whether they decide the condition.

        They find a fault that the windows did not show, as one that may have begun in each of its seconds,
        and never end one. The flight is normal if they exclude an emergency.
        """
        if SEVERITY[self.condition] > 0 or not ratios.size:
            return False
        after, alarms = self.condition, min(exp(-self._test.threshold) * seconds, MOST_FLIGHT_TAIL)
        if mean_ratio(ratios) >= -log(alarms):
            shares = np.exp(ratios - ratios.max())
            after = self._fault(float(shares[self._grave].sum() / shares.sum()))
        elif mean_ratio(ratios[self._grave]) <= -EXCLUDING:
            after = "normal"
        return self._change(after, start_s)

    def _change(self, after: Condition, since_s: float) -> bool:
        if after == self.condition:
            return False
        self.condition, self.since_s = after, since_s
        return True

    def surely_grave(self, ratios: Array) -> bool:
        """Return whether the ratios of a whole flight, shape (g,), show an emergency and nothing else."""
        other = max(mean_ratio(ratios[~self._grave]), 0.0)
        return mean_ratio(ratios[self._grave]) - other >= self._test.threshold

    def _add_health(self, end_s: float, ratio: float) -> None:
        """Add what a window says for health, by the share of its slots that the one before did not have."""
        if (ratio > 0.0) != (self._latest > 0.0) or self._last_s < 0.0:
            self._speaks_s = end_s
        share = min((end_s - self._last_s) / WINDOW_S, 1.0)
        self._health = max(self._health, 0.0) + share * ratio
        self._latest, self._last_s = ratio, end_s

    def _fault(self, grave: float) -> Condition:
        """Return the condition of a fault that is grave with this probability."""
        least = exp(-self._test.threshold) if self.condition == "emergency" else TAIL_95
        return "emergency" if grave >= least else "degraded"

    def _onset(self, after: Condition, end_s: float) -> float:
        """Return since when a condition holds that begins with the window that ends then."""
        if after == "normal":
            end_s = self._speaks_s
        elif SEVERITY[self.condition] <= SEVERITY["normal"]:
            end_s = min(self._speaks_s, self._test.since or end_s)
        throughout = self.condition == "undecided" or (self._span_s and after != "normal")
        return end_s - (self._span_s or WINDOW_S) * (1.0 if throughout else 0.5)


def mean_ratio(ratios: Array) -> float:
    """Return the logarithm of the mean of likelihood ratios; minus infinity without any."""
    return float(np.logaddexp.reduce(ratios)) - log(max(ratios.size, 1))


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
        # Windows slide by a slot: only each tenth one is independent.
        before = np.minimum(freedom * (count // WINDOW_SLOTS), MOST_POOLED_FREEDOM)
        pooled = (freedom * squares + before * total / np.maximum(count, 1)) / (freedom + before)
        return Estimates(estimates.value, np.maximum(error, np.sqrt(pooled)), freedom + before)
