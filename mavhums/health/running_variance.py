"""Online standard deviation (B. P. Welford, Technometrics 4, 1962)."""

from __future__ import annotations

from math import sqrt

__all__ = ["RunningVariance"]


class RunningVariance:
    """Updates count, mean and sum of squared deviations with each number.

    Examples
    --------
    >>> variance = RunningVariance()
    >>> for number in (1.0, 2.0, 3.0):
    ...     variance.add(number)
    >>> variance.count, variance.deviation
    (3, 1.0)
    """

    def __init__(self) -> None:
        self.count = 0
        self._mean = self._squares = 0.0

    def add(self, number: float) -> None:
        """Add a number."""
        self.count += 1
        before = number - self._mean
        self._mean += before / self.count
        self._squares += before * (number - self._mean)

    @property
    def deviation(self) -> float | None:
        """Standard deviation; None for fewer than two numbers."""
        return sqrt(self._squares / (self.count - 1)) if self.count > 1 else None
