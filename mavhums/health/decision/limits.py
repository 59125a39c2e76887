"""The sequential decision: converts a quantity's windows to its condition.

A window indicates *normal* unless its whole interval lies above the normal limit, *emergency* if the interval
reaches the emergency limit, and *degraded* in between; if the interval contains both limits, the window is
inconclusive. α is the allowed false-alarm probability of a 10 s window; the interval has the tail probability
√α on either side. The condition changes when consecutive windows agree: over the length of two windows that
share no sample, or five windows if even the interval with tail probability α agrees. Inconclusive windows
change nothing. A fault that one window proves through all of it (a jam) needs no second window to begin, only
to end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import TAIL_95, t_quantile
from mavhums.health.decision.thresholds import (
    CONFIRM_WINDOWS,
    LASTING_WINDOWS,
    MOST_POOLED_FREEDOM,
    WINDOWS_PER_100_H,
)
from mavhums.health.estimation.thresholds import WINDOW_SLOTS
from mavhums.results.standing import Interval

_CONDITIONS: dict[int, Condition] = {-1: "undecided", 0: "normal", 1: "degraded", 2: "emergency"}


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

    def at(self, which: Flags | int) -> Estimates:
        """Return a subset of the windows, or one quantity of estimates of shape (d, k)."""
        return Estimates(*(array[which] for array in self))


def tail_of(false_alarms: float) -> float:
    """Return the allowed false-alarm probability of one 10 s window, given the alarms per 100 hours."""
    return false_alarms / WINDOWS_PER_100_H


def half_width(estimates: Estimates, *, tail: float | Array) -> Array:
    """Return half the width of intervals with this tail probability on either side, shape (k,).

    Few degrees of freedom make heavy tails. Several tails, shape (t, 1), give a row of widths each. The
    windows of a flight share some fifty degrees of freedom, so that each quantile is computed once.
    """
    distinct, place = np.unique(estimates.freedom, return_inverse=True)
    quantiles = t_quantile(distinct, 1.0 - tail)
    width: Array = quantiles[..., place.reshape(estimates.freedom.shape)] * estimates.error
    return width


def bounds(levels: Levels) -> tuple[float, float]:
    """Return the limits as numbers: NaN for no normal limit, infinity for no emergency limit."""
    normal, emergency = levels
    return np.nan if normal is None else normal, np.inf if emergency is None else emergency


def shown_by(low: Array, high: Array, normal: float | Array, emergency: float | Array) -> Integers:
    """Return the severity that intervals show, -1 for nothing, in the shape of the intervals.

    Examples
    --------
    >>> shown_by(np.array([0.36, 0.40, 0.80, 0.30]), np.array([0.44, 0.48, 0.90, 0.95]), 0.375, 0.875)
    array([ 0,  1,  2, -1])
    """
    # An interval over both limits says nothing: -1.
    reached = high >= emergency
    severity = np.where(low > normal, np.where(reached, 2, 1), np.where(reached, -1, 0))
    return np.where(np.isnan(low) | np.isnan(normal), -1, severity)


class Decision:
    """Tracks the condition of one quantity of one actuator through the flight.

    Parameters
    ----------
    levels
        Limits of the quantity.
    proven
        Whether one window proves a fault, and that it lasted through all of it.

    Attributes
    ----------
    condition
        The current condition.
    since_s
        Flight time of its onset: the middle of the first window that indicated it; for the first
        condition of a flight, that window's start.
    """

    def __init__(self, levels: Levels, *, proven: bool = False) -> None:
        self._proven = proven
        self.condition: Condition = "undecided"
        self.since_s: float | None = None
        self.levels = levels
        self._candidate = -1
        self._run = self._sure = 0
        self._first_s = 0.0

    def settle(self, shown: int, start_s: float) -> bool:
        """Process the severity of the whole flight; return whether it decides the condition.

        It decides if no run of windows did, or if it is a fault and the windows were normal.
        """
        # The whole flight mends silence and finds faults; it never ends one.
        if shown < 0 or SEVERITY[self.condition] > 0 or _CONDITIONS[shown] == self.condition:
            return False
        self.condition, self.since_s = _CONDITIONS[shown], start_s
        return True

    def feed(self, shown: int, start_s: float, end_s: float, *, sure: bool = True) -> bool:
        """Process the severity of one window, and return whether it changes the condition.

        ``sure`` is True if the wider interval gives the same severity.
        """
        if shown < 0:
            return False
        if shown != self._candidate:
            self._candidate, self._run, self._sure = shown, 0, 0
            # The first condition of a flight holds from the window's start; a change lies somewhere within
            # it.
            throughout = self.condition == "undecided" or (self._proven and shown > 0)
            self._first_s = start_s if throughout else (start_s + end_s) / 2
        self._run += 1
        self._sure = self._sure + 1 if sure else 0
        after = _CONDITIONS[shown]
        # A window that a fault lasted through needs no second one to begin, only to end.
        confirm = 1 if self._proven and shown > SEVERITY[self.condition] else CONFIRM_WINDOWS
        if after == self.condition or (self._sure < confirm and self._run < LASTING_WINDOWS):
            return False
        self.condition, self.since_s = after, self._first_s
        return True


class Levels(NamedTuple):
    """The quantity's upper limit for normal and lower limit for an emergency; None if there is none."""

    normal: float | None = None
    emergency: float | None = None


class WindowEvaluation(NamedTuple):
    """Evaluation of one quantity in k windows; arrays of shape (k,).

    Attributes
    ----------
    own, steadied
        The estimates, with each window's own error, and with the error pooled over earlier windows.
    half
        Half the width of each window's own 95 % interval.
    severity, sure
        Severity by the interval with tail probability √α, -1 if inconclusive; and whether the interval
        with tail probability α agrees.
    """

    own: Estimates
    steadied: Estimates
    half: Array
    severity: Integers
    sure: Flags

    def intervals(self) -> dict[int, Interval]:
        """Return the 95 % intervals of the windows with evidence, by window."""
        value, half = self.own.value, self.half
        return {
            k: Interval(estimate=float(value[k]), low=float((value - half)[k]), high=float((value + half)[k]))
            for k in np.flatnonzero(np.isfinite(value)).tolist()
        }


class Panel:
    """Compares the windows of several quantities with their limits.

    Parameters
    ----------
    levels
        Limits of the quantities.
    two_sided
        Whether each is normal near zero, and not below a value.
    false_alarms
        Alarms per 100 hours.
    """

    def __init__(self, levels: Sequence[Levels], two_sided: Sequence[bool], false_alarms: float) -> None:
        self._two_sided = np.array(two_sided)[:, None]
        limits = np.array([bounds(each) for each in levels])
        self._normal, self._emergency = limits[:, :1], limits[:, 1:]
        self._tails = tail_of(false_alarms) ** np.array([0.5, 1.0])[:, None]
        self._errors = PooledErrors()

    def feed(self, estimates: Sequence[Estimates], windows: Flags) -> list[WindowEvaluation]:
        """Evaluate each detector's estimates in the selected windows, shape (k,)."""
        own = Estimates(*(np.array(arrays)[:, windows] for arrays in zip(*estimates, strict=True)))
        steadied = self._errors.feed(own)
        size = np.where(self._two_sided, np.abs(own.value), own.value)
        half = half_width(steadied, tail=self._tails)
        severity, surely = shown_by(size - half, size + half, self._normal, self._emergency)
        # Normal claims nothing that the wide interval could deny.
        sure = (severity == SEVERITY["normal"]) | (surely > 0)
        printed = half_width(own, tail=TAIL_95)
        return [
            WindowEvaluation(own.at(k), steadied.at(k), printed[k], severity[k], sure[k])
            for k in range(len(estimates))
        ]


class PooledErrors:
    """Pools the errors of each quantity's windows incrementally."""

    def __init__(self) -> None:
        self._sum: Array = np.zeros(1)
        self._count: Integers = np.zeros(1, dtype=np.int64)

    def feed(self, estimates: Estimates) -> Estimates:
        """Return the estimates with pooled errors and the resulting degrees of freedom.

        Estimates of several quantities have the shape (d, k).
        """
        shown = np.isfinite(estimates.value)
        if not shown.size:
            return estimates
        squares = np.where(shown, estimates.error**2, 0.0)
        total = squares.copy()
        # The running sums go on from the block before.
        total[..., :1] += self._sum
        total = total.cumsum(axis=-1)
        count = self._count + shown.cumsum(axis=-1)
        self._sum, self._count = total[..., -1:], count[..., -1:]
        freedom, error = estimates.freedom, estimates.error
        # Windows slide by a slot: only each tenth one is independent.
        before = np.minimum(freedom * (count // WINDOW_SLOTS), MOST_POOLED_FREEDOM)
        pooled = (freedom * squares + before * total / np.maximum(count, 1)) / (freedom + before)
        return Estimates(estimates.value, np.maximum(error, np.sqrt(pooled)), freedom + before)
