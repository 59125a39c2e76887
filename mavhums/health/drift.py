"""Sequential detection of a change from the actuator's own baseline.

Non-overlapping windows add their estimates. The mean of the last 1, 2, 3, 5, 8 … windows, weighted by
certainty, is compared with the baseline: a generalised likelihood ratio
(D. Siegmund, E. S. Venkatraman, "Using the generalized likelihood ratio statistic for sequential
detection of a change-point", Annals of Statistics 23, 1995), studentised, because the scatter is
heavy-tailed and not known in advance. At the end, the whole flight is tested once more. Half of the
allowed false alarms are for the tests in flight, half for the last test.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mavhums.health.baseline import Baseline
from mavhums.health.decision import FALSE_ALARMS, tail_of
from mavhums.health.windows import WINDOW_SLOTS

__all__ = ["Drift", "Shift"]

_SPANS = (1, 2, 3, 5, 8, 13, 21, 34)
_LOOKS = 4.0  # effective number of independent tests of the overlapping spans
_FREEDOM = WINDOW_SLOTS - 1.0

Array = NDArray[np.float64]


class Shift(NamedTuple):
    """Deviation of the last windows from the baseline.

    Attributes
    ----------
    value, error
        The quantity minus its baseline, and the standard error of the difference.
    ratio
        Shift divided by its threshold at the false-alarm rate; an alarm from 1 on.
    since_s
        Start of the first of these windows.
    """

    value: float
    error: float
    ratio: float
    since_s: float


class Drift:
    """Compares one quantity of one actuator with its baseline through the flight.

    Parameters
    ----------
    baseline
        Baseline of the same quantity and actuator.
    two_sided
        Whether a decrease alarms like an increase.
    false_alarms
        Alarms per 100 hours.

    Attributes
    ----------
    alarm
        The shift at the first alarm; None before.

    Examples
    --------
    >>> drift = Drift(Baseline(0.2, error=0.001, flights=10, between=0.002, spread=0.003))
    >>> for k in range(12):
    ...     shift = drift.feed(0.25, 0.01, 9.0, 10.0 * k)
    >>> drift.alarm.since_s
    0.0
    """

    def __init__(
        self, baseline: Baseline, *, two_sided: bool = False, false_alarms: float = FALSE_ALARMS
    ) -> None:
        self.baseline = baseline
        self.alarm: Shift | None = None
        self._two_sided = two_sided
        self._tail = tail_of(false_alarms) / 2 / (2 if two_sided else 1)
        self._windows: deque[_Window] = deque(maxlen=_SPANS[-1])

    def feed(self, value: float, error: float, freedom: float, start_s: float) -> Shift:
        """Add a window that does not overlap the previous one; return the most significant shift."""
        self._windows.append(_Window(value - self.baseline.mean, error, freedom, start_s))
        tail = self._tail / _LOOKS
        shifts = [self._over(span, tail) for span in _SPANS if span <= len(self._windows)]
        return self._heed(max(shifts, key=lambda shift: shift.ratio))

    def conclude(self, value: float, error: float, freedom: float, start_s: float) -> Shift:
        """Test once more, with the estimate of the whole flight or with all its windows.

        The more certain of the two counts; a window's error excludes errors that all flights share.
        """
        count = max(len(self._windows), 1)
        tail = self._tail * count
        whole = self._shift(value - self.baseline.mean, error**2, freedom, start_s, tail)
        together = self._over(count, tail) if self._windows else whole
        return self._heed(min(whole, together, key=lambda shift: shift.error))

    def _heed(self, shift: Shift) -> Shift:
        if self.alarm is None and shift.ratio >= 1.0:
            self.alarm = shift
        return shift

    def _over(self, span: int, tail: float) -> Shift:
        values, errors, freedoms, starts_s = np.array(self._windows)[-span:].T
        weights = 1.0 / np.maximum(errors, 1e-12) ** 2
        shift = float(weights @ values / weights.sum())
        scatter = float(weights @ (values - shift) ** 2 / max(span - 1, 1))
        own = float(max(scatter, 1.0) / weights.sum())
        freedom = max(float(freedoms.max()), _FREEDOM * span)
        return self._shift(shift, own, freedom, float(starts_s[0]), tail)

    def _shift(self, shift: float, own: float, own_freedom: float, since_s: float, tail: float) -> Shift:
        """Return a shift of known variance, relative to its threshold for this tail probability."""
        flight = self.baseline.flight_variance
        error = float(np.sqrt(own + flight))
        freedom = _satterthwaite(own, own_freedom, flight, self.baseline.certainty)
        size = abs(shift) if self._two_sided else shift
        return Shift(shift, error, size / (float(stdtrit(freedom, 1.0 - tail)) * error), since_s)


class _Window(NamedTuple):
    """A window's estimate minus the baseline, its standard error, degrees of freedom, and start."""

    value: float
    error: float
    freedom: float
    start_s: float


def _satterthwaite(first: float, first_freedom: float, second: float, second_freedom: float) -> float:
    """Return the degrees of freedom of a sum of two variances (F. E. Satterthwaite, 1946)."""
    return (first + second) ** 2 / (first**2 / first_freedom + second**2 / second_freedom)
