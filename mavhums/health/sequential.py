"""The sequential test: an e-detector over a grid of hypotheses about what a fault does.

Each unit of a flight, a second, gives the logarithm of its likelihood ratio of each hypothesis against
health. The statistic of Shiryaev and Roberts sums the ratios over all seconds at which the fault may have
begun, M ← (1 + M)·ratio. In healthy flight it grows by at most one a unit on average, and so does a weighted
mean of several: the mean time to a threshold is no shorter than as many units, so the threshold is the time
between false alarms. The way back is the same test with the roles exchanged.

References
----------
S. W. Roberts, "A comparison of some control chart procedures", Technometrics 8, 1966.
J. Shin, A. Ramdas and A. Rinaldo (2024), New England J. of Statistics in Data Science 2:229: e-detectors.
"""

from __future__ import annotations

from math import inf, log
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Array1, Integers1
from mavhums.core.kernels import kernel

EXCLUDING: Final = log(20.0)
"""Evidence against a fault with 95 %, and of what else holds with 95 %."""

PER_100_H: Final = 360_000.0
"""Seconds in 100 hours."""

_MOST: Final = 200.0  # logarithm: what is certain needs no larger number


def threshold(false_alarms: float) -> float:
    """Return the evidence of an alarm for a number of false alarms in 360,000 units."""
    return log(PER_100_H / false_alarms)


@kernel
def accumulate(at: int, ratios: Array1, values: Array1, sums: Array1, since: Integers1) -> None:
    """Add a unit's logarithms of likelihood ratios to the statistics of the hypotheses, all of one shape.

    Parameters
    ----------
    at
        Its time.
    ratios
        Of each hypothesis against health.
    values
        Logarithms of the statistics of Shiryaev and Roberts; −∞ before the first unit.
    sums, since
        Sums of the ratios since the fault begins, by each hypothesis, and the time of that.
    """
    for k in np.ndindex(ratios.shape):
        # A fault begins where the sum that makes it likely begins.
        if sums[k] <= 0.0:
            sums[k], since[k] = 0.0, at
        sums[k] += ratios[k]
        values[k] = max(values[k], 0.0) + np.log1p(np.exp(-abs(values[k]))) + ratios[k]
    values -= max(values.max() - _MOST, 0.0)


class SequentialTest:
    """Decides whether a fault is present, from the alarm until its end is as certain.

    Parameters
    ----------
    weights
        Prior weight of each hypothesis, shape (n,).
    false_alarms
        Accepted number of false alarms in 360,000 units, seconds of 100 hours, of health, and of false ends
        in as many units of a fault. Ten times as many find a fault sooner by the seconds that make an
        evidence of ln 10.

    Attributes
    ----------
    alarm
        Whether a fault is present.
    threshold
        Evidence of an alarm.

    Examples
    --------
    A mean of 0 against one of −1, with a standard deviation of 0.5: the fault lasts from 3 s to 9 s.

    >>> test = SequentialTest(np.ones(1), false_alarms=360.0)
    >>> values = [0.1, -0.2, 0.1, -1.1, -0.8, -1.0, -0.9, -1.0, -1.2, 0.1, -0.1, 0.0, 0.2, 0.1, 0.0]
    >>> ratios = [-2.0 * (2.0 * value + 1.0) for value in values]
    >>> [second for second, ratio in enumerate(ratios) if test.feed(second, np.array([ratio]), ratio)]
    [6, 7, 8, 9, 10, 11]
    """

    def __init__(self, weights: Array, false_alarms: float) -> None:
        self._weights: Array = np.log(weights / weights.sum())
        self.threshold = threshold(false_alarms)
        self.alarm = False
        self._clear()

    def _clear(self) -> None:
        self._values = np.full(self._weights.shape, -inf)
        self._sums = np.zeros(self._weights.shape)
        self._since = np.full(self._weights.shape, -1)
        self._back = -inf

    def feed(self, at: int, ratios: Array, back: float) -> bool:
        """Take a unit; return whether a fault is present.

        Parameters
        ----------
        at
            Its time.
        ratios
            Logarithms of its likelihood ratios of the hypotheses against the most likely kind of health,
            shape (n,).
        back
            The same of the likeliest hypothesis (:attr:`likeliest`) against perfect health.
        """
        accumulate(at, ratios, self._values, self._sums, self._since)
        if not self.alarm:
            self.alarm, self._back = self.evidence >= self.threshold, -inf
            return self.alarm
        self._back = float(np.logaddexp(0.0, self._back)) - back
        if self._back >= self.threshold:
            self.alarm = False
            self._clear()
        return self.alarm

    @property
    def evidence(self) -> float:
        """Logarithm of the weighted mean of the hypotheses' statistics, for ``threshold``."""
        return float(np.logaddexp.reduce(self._values + self._weights))

    @property
    def likeliest(self) -> int:
        """Index of the hypothesis with the largest part of the evidence."""
        return int(np.argmax(self._values + self._weights))

    @property
    def since(self) -> int | None:
        """Time at which the likeliest hypothesis begins; None without one."""
        k = self.likeliest
        return int(self._since[k]) if self._sums[k] > 0.0 else None

    def shares(self) -> Array:
        """Return the probability of each hypothesis if one of them holds, shape (n,)."""
        parts = np.exp(np.maximum(self._values, -_MOST) + self._weights - max(self.evidence, -_MOST))
        return np.asarray(parts / parts.sum(), dtype=np.float64)
