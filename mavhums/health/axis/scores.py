"""Evidence about an axis: sums of products over each second, and the effectiveness that they show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.regressions import Columns, HighPass
from mavhums.health.axis.thresholds import (
    WINDOW_DEVIATION,
    WINDOW_SECONDS,
)
from mavhums.vehicle.grid import RATE_HZ


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over each second, shape (seconds,), and the ``rows`` of ``driven`` and ``raw`` that are good."""

    drive2: Array
    cross: Array
    answer2: Array
    drive: Array
    driven: Array
    raw: Array
    count: Integers
    rows: tuple[Array, Array, Flags]


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
        return Sums(drive2, cross, answer2, drive_sum, total, left, counts, (driven, raw, good))


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
