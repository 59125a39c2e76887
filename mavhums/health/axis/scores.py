"""Evidence about an axis: sums of products over each second, effectiveness pooled over up to a minute."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.regressions import Columns, HighPass
from mavhums.health.axis.thresholds import (
    NORMAL_EFFECTIVENESS,
    POOLED_ERROR,
    POOLED_REFERENCE_S,
    POOLED_S,
    WINDOW_DEVIATION,
    WINDOW_SECONDS,
)
from mavhums.results.standing import Interval
from mavhums.vehicle.grid import RATE_HZ


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over each second, shape (seconds,)."""

    drive2: Array
    cross: Array
    answer2: Array
    drive: Array
    driven: Array
    raw: Array
    count: Integers


class Scores:
    """Removes the nuisances and the slow parts, and sums products over each second.

    Parameters
    ----------
    others
        Weights of the nuisances.
    memory_s
        Memory of the filter that removes the slow parts.
    """

    def __init__(self, others: Array, memory_s: float) -> None:
        self._others = others
        self._drive, self._answer = HighPass(memory_s), HighPass(memory_s)

    def feed(self, columns: Columns) -> Sums:
        """Return the sums of each new second."""
        good = columns.good
        other = sum(
            (columns.others[:, k] * weight for k, weight in enumerate(self._others)),
            start=np.zeros(len(good)),
        )
        driven = np.where(good, columns.drive, 0.0)
        raw = np.where(good, columns.answer - other, 0.0)
        drive, answer = self._drive.feed(driven), self._answer.feed(raw)
        shape = (-1, RATE_HZ)
        products = (drive * drive, drive * answer, answer * answer, drive, driven, raw)
        summed = [np.where(good, product, 0.0).reshape(shape).sum(axis=1) for product in products]
        drive2, cross, answer2, drive_sum, total, left = summed
        counts = good.reshape(shape).sum(axis=1)
        return Sums(drive2, cross, answer2, drive_sum, total, left, counts)


def measured(drive2: Array, cross: Array, reference: Reference) -> tuple[Array, Array]:
    """Return the effectiveness over the last n seconds and its standard error, for each n from 1 on.

    Parameters
    ----------
    drive2, cross
        Sums of squares of the drive, and of its products with the response, by second, the last one first;
        shape (n,).
    reference
        The reference that the effectiveness is relative to.

    Returns
    -------
    tuple
        Two arrays of shape (n,); the error is infinite where the seconds do not show the effectiveness.
    """
    n = np.arange(1.0, len(drive2) + 1.0)
    total = drive2.cumsum()
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = cross.cumsum() / total
        # Scatter of the seconds' scores about this gain, from sums that grow by a second each.
        mixed, squared = (cross * drive2).cumsum(), (drive2**2).cumsum()
        squares = (cross**2).cumsum() - 2.0 * gain * mixed + gain**2 * squared
        own = np.maximum(squares * n / (n - 1.0) / total, reference.variance) / total
        k = gain / reference.gain
        # Healthy windows differ by this whatever their own errors say.
        spread = WINDOW_DEVIATION**2 * np.minimum(WINDOW_SECONDS / n, 1.0)
        error = np.sqrt(own / reference.gain**2 + (k * reference.error) ** 2 + spread)
    known = (n > 1.0) & (total > 0.0)
    return np.where(known, k, np.nan), np.where(known, error, np.inf)


class Pool:
    """The last seconds of an axis.

    Parameters
    ----------
    most_s
        Largest number of seconds.
    """

    def __init__(self, reference: Reference, most_s: int) -> None:
        self._reference = reference
        self._seconds: deque[tuple[float, float]] = deque(maxlen=most_s)

    def add(self, drive2: float, cross: float) -> None:
        """Add a second: sums of squares of the drive, and of its products with the response."""
        self._seconds.append((drive2, cross))

    def fewest(self) -> tuple[int, Interval] | None:
        """Return how many of the last seconds show the effectiveness well, and its interval over them."""
        drive2, cross = np.reshape(self._seconds, (-1, 2))[::-1].T
        k, error = measured(drive2, cross, self._reference)
        # They are chosen by their error alone: chosen by its value, they would be the luckiest of many.
        well = np.flatnonzero(error[WINDOW_SECONDS - 1 :] <= POOLED_ERROR)
        if not well.size:
            return None
        n = int(well[0]) + WINDOW_SECONDS
        return n, _interval(k[n - 1], error[n - 1])


def _interval(value: float, error: float) -> Interval:
    half = NORMAL_95 * float(error)
    return Interval(estimate=float(value), low=float(value) - half, high=float(value) + half)


class LossExclusion:
    """Counts the seconds over which a loss of 40 % or more is excluded with 95 %.

    The seconds of the reference count, too, over at most 20 of its 45: a mean over all of them would be that
    of the reference itself. Later windows hold none of them for the same reason.
    """

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._pool = Pool(reference, POOLED_REFERENCE_S)
        self._waiting = 0  # seconds since the last one over which a loss is excluded

    def begin(self, seconds: Iterable[tuple[float, float]]) -> int:
        """Take the seconds until the reference's end; return over how many of them a loss is excluded."""
        excluded = sum(self.feed(*second) for second in seconds)
        self._pool = Pool(self._reference, POOLED_S)
        return excluded

    def feed(self, drive2: float, cross: float) -> int:
        """Take a second; return over how many seconds a loss is excluded by now, and was not before."""
        self._waiting += 1
        self._pool.add(drive2, cross)
        pooled = self._pool.fewest()
        if pooled is None or pooled[1].low <= NORMAL_EFFECTIVENESS:
            return 0
        new = min(self._waiting, pooled[0])
        self._waiting = 0
        return new
