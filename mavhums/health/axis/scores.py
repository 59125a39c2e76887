"""Sums of products of the drive and the response over each second, both without their slow parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.health.axis.chain import Columns
from mavhums.health.axis.filters import HighPass
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["Scores", "Sums"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over each second, shape (seconds,)."""

    drive2: Array
    cross: Array
    answer2: Array
    driven: Array
    raw: Array
    count: NDArray[np.int64]


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
        products = (drive * drive, drive * answer, answer * answer, driven, raw)
        summed = [np.where(good, product, 0.0).reshape(shape).sum(axis=1) for product in products]
        drive2, cross, answer2, total, left = summed
        return Sums(drive2, cross, answer2, total, left, good.reshape(shape).sum(axis=1))
