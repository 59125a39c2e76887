"""Sums of products of the drive and the response over each second, both without their slow parts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.health.axis.filters import HighPass
from mavhums.health.axis.regressions import Columns
from mavhums.health.axis.thresholds import (
    DOUBTFUL_S,
    EXTRA_LAGS_S,
    LAG_BETTER,
    LAG_GAIN,
    LAG_GAIN_KEPT,
    LAG_MUCH_BETTER,
)
from mavhums.vehicle.grid import RATE_HZ


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over each second, shape (seconds,)."""

    drive2: Array
    cross: Array
    answer2: Array
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
        products = (drive * drive, drive * answer, answer * answer, driven, raw)
        summed = [np.where(good, product, 0.0).reshape(shape).sum(axis=1) for product in products]
        drive2, cross, answer2, total, left = summed
        return Sums(drive2, cross, answer2, total, left, good.reshape(shape).sum(axis=1))


class Slowness:
    """Follows one suspected loss.

    Attributes
    ----------
    lag
        Index of the lag that explained more so far: 0 for none, else one above that in ``EXTRA_S``.
    """

    def __init__(self) -> None:
        self.lag = 0
        self._is_slow = False

    def feed(self, seconds: Collection[Array], full: float) -> tuple[float | None, bool]:
        """Return the lag, s, that explains much more than a loss, and whether any lag explains more.

        A lag that was found once stays as long as it explains more and leaves most of the gain.

        Parameters
        ----------
        seconds
            The last seconds of the suspected loss: sums of squares of the drive, of products, and of squares
            of the response, by lag, shape (1 + len(EXTRA_S), 3).
        full
            The gain of the reference.
        """
        # A single manoeuvre shows no lag.
        if len(seconds) < DOUBTFUL_S:
            return None, False
        drive2, cross, answer2 = np.sum(list(seconds), axis=0).T
        with np.errstate(divide="ignore", invalid="ignore"):
            # Columns of the sums are drive², drive·response and response², rows the lags.
            gain = cross / drive2 / full
            share = np.nan_to_num(cross**2 / (drive2 * answer2))
        best = int(np.argmax(share))
        better = float(share[best] - share[0])
        later = better >= LAG_BETTER
        if later:
            self.lag = best
        # With two limits a servo at the limit is not called slow and lost by turns.
        whole = LAG_GAIN_KEPT if self._is_slow else LAG_GAIN
        self._is_slow = later and (self._is_slow or better >= LAG_MUCH_BETTER) and bool(gain[best] >= whole)
        return (EXTRA_LAGS_S[best - 1] if self._is_slow else None), later
