"""A change against the actuator's own baseline, found as soon as the evidence of several windows suffices.

Each window that does not overlap the one before adds its estimate. For the last 1, 2, 3, 5, 8 … of them the
mean, weighted with the windows' certainty, is compared with the baseline: a generalised likelihood ratio
(D. Siegmund, E. S. Venkatraman, "Using the generalized likelihood ratio statistic for sequential
detection of a change-point", Annals of Statistics 23, 1995), studentised, because the scatter is
heavy-tailed and never known beforehand.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from mavhums.health.baseline import Baseline
from mavhums.health.decision import FALSE_ALARMS, tail_of

__all__ = ["Drift", "Shift"]

_SPANS = (1, 2, 3, 5, 8, 13, 21, 34)
_LOOKS = 4.0  # as many independent looks as the overlapping spans are worth
_PRIOR_WEIGHT = 10.0  # windows that the baseline's scatter counts for in a window's own


class Shift(NamedTuple):
    """How far the last windows lie from the baseline.

    Attributes
    ----------
    value, error
        The quantity less its baseline, and the standard error of that.
    ratio
        Of the shift to what chance alone would reach at the false-alarm rate; an alarm from 1 on.
    since_s
        Start of the windows that show it.
    """

    value: float
    error: float
    ratio: float
    since_s: float


class Drift:
    """Follows one quantity of one actuator against its baseline.

    Parameters
    ----------
    baseline
        Of the same quantity and actuator.
    two_sided
        Whether a fall alarms like a rise.
    false_alarms
        Alarms per 100 hours.

    Attributes
    ----------
    alarm
        The shift at the first alarm; None before.

    Examples
    --------
    >>> drift = Drift(Baseline(mean=0.2, flights=10, between=0.002, windows=100, within=0.01))
    >>> for k in range(12):
    ...     shift = drift.feed(0.25, 0.01, 10.0 * k)
    >>> drift.alarm.since_s
    0.0
    """

    def __init__(
        self, baseline: Baseline, *, two_sided: bool = False, false_alarms: float = FALSE_ALARMS
    ) -> None:
        self.baseline = baseline
        self.alarm: Shift | None = None
        self._two_sided = two_sided
        self._tail = tail_of(false_alarms) / _LOOKS / (2 if two_sided else 1)
        self._windows: deque[tuple[float, float, float]] = deque(maxlen=_SPANS[-1])

    def feed(self, value: float, error: float, start_s: float) -> Shift:
        """Take a window that does not overlap the one before; return the shift that shows most."""
        base = self.baseline
        within = (error**2 * 9.0 + base.within**2 * _PRIOR_WEIGHT) / (9.0 + _PRIOR_WEIGHT)
        self._windows.append((value - base.mean, within, start_s))
        shifts = [self._over(span) for span in _SPANS if span <= len(self._windows)]
        most = max(shifts, key=lambda shift: shift.ratio)
        if self.alarm is None and most.ratio >= 1.0:
            self.alarm = most
        return most

    def conclude(self, value: float, error: float, freedom: float, start_s: float) -> None:
        """Take the estimate of a whole flight that began at ``start_s``, as one look more."""
        shift = self._shift(value - self.baseline.mean, error**2, freedom, self._tail * _LOOKS, start_s)
        if self.alarm is None and shift.ratio >= 1.0:
            self.alarm = shift

    def _over(self, span: int) -> Shift:
        rows = np.array(self._windows)[-span:]
        weights = 1.0 / rows[:, 1]
        shift = float(weights @ rows[:, 0] / weights.sum())
        scatter = float(weights @ (rows[:, 0] - shift) ** 2 / max(span - 1, 1))
        own = float(max(scatter, 1.0) / weights.sum())
        return self._shift(shift, own, 9.0 * span + _PRIOR_WEIGHT, self._tail, float(rows[0, 2]))

    def _shift(self, shift: float, own: float, freedom: float, tail: float, since_s: float) -> Shift:
        """Return a shift whose own variance is known so well, against what chance reaches in one look."""
        flight = self.baseline.flight_variance
        error = float(np.sqrt(own + flight))
        freedom = _satterthwaite(own, freedom, flight, self.baseline.flights - 1.0)
        size = abs(shift) if self._two_sided else shift
        return Shift(shift, error, size / (float(stdtrit(freedom, 1.0 - tail)) * error), since_s)


def _satterthwaite(first: float, first_freedom: float, second: float, second_freedom: float) -> float:
    """Return the degrees of freedom of a sum of two variances (F. E. Satterthwaite, 1946)."""
    return (first + second) ** 2 / (first**2 / first_freedom + second**2 / second_freedom)
