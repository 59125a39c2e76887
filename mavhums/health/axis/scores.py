"""Evidence about an axis: sums of products over each second, effectiveness pooled over up to a minute."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.regressions import Columns, HighPass
from mavhums.health.axis.thresholds import (
    DOUBTFUL_S,
    EXTRA_LAGS_S,
    LAG_BETTER,
    LAG_GAIN,
    LAG_GAIN_KEPT,
    LAG_MUCH_BETTER,
    NORMAL_EFFECTIVENESS,
    POOLED_CALM,
    POOLED_ERROR,
    POOLED_LEAST_S,
    POOLED_NOISE,
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


class ServoLag:
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
        self._seconds: deque[tuple[float, float, float]] = deque(maxlen=most_s)

    def add(self, drive2: float, cross: float, answer2: float = 0.0) -> None:
        """Add a second: sums of squares of drive and response, and of their products."""
        self._seconds.append((drive2, cross, answer2))

    def clear(self) -> None:
        """Forget all seconds."""
        self._seconds.clear()

    def steady(self) -> bool:
        """Return whether some gain explains the seconds, and not gusts: these lower a healthy axis's gain."""
        drive2, cross, answer2 = np.sum(self._seconds, axis=0) if self._seconds else np.zeros(3)
        if drive2 <= 0.0:
            return False
        unexplained = (answer2 - cross**2 / drive2) / drive2
        most = POOLED_NOISE if len(self._seconds) >= POOLED_LEAST_S else POOLED_CALM
        return bool(unexplained <= most * self._reference.gain**2)

    def fewest(self) -> tuple[int, Interval] | None:
        """Return how many of the last seconds show the effectiveness well, and its interval over them."""
        drive2, cross, _ = np.array(self._seconds)[::-1].T if self._seconds else np.zeros((3, 0))
        k, error = measured(drive2, cross, self._reference)
        # They are chosen by their error alone: chosen by its value, they would be the luckiest of many.
        well = np.flatnonzero(error[WINDOW_SECONDS - 1 :] <= POOLED_ERROR)
        if not well.size:
            return None
        n = int(well[0]) + WINDOW_SECONDS
        return n, _interval(k[n - 1], error[n - 1])

    def whole(self) -> Interval | None:
        """Return the effectiveness over all seconds with its 95 % interval; None if they do not show it."""
        drive2, cross, _ = np.array(self._seconds)[::-1].T if self._seconds else np.zeros((3, 0))
        k, error = measured(drive2, cross, self._reference)
        is_known = len(k) >= WINDOW_SECONDS and error[-1] <= POOLED_ERROR
        return _interval(k[-1], error[-1]) if is_known else None


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
