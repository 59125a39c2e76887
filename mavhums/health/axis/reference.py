"""An axis's reference: what it must show, what it holds, and later seconds relative to it, by their sums."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.health.axis.regressions import Basis, Columns, Form, HighPass, Shape
from mavhums.health.axis.thresholds import (
    DELAYS_S,
    GUST_WINDOW_S,
    LAGS_S,
    MEAN_ROWS,
    REFERENCE_S,
    WINDOW_DEVIATION,
)
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.vehicle.grid import RATE_HZ


def shapes(axis: str) -> list[Shape]:
    """Return the candidates for an axis's own response."""
    return [Shape(round(delay * RATE_HZ), tau) for delay in DELAYS_S[axis] for tau in LAGS_S[axis]]


@dataclass(frozen=True, slots=True)
class Reference:
    """The axis's response in the reference.

    Attributes
    ----------
    error
        Relative standard error of the gain.
    deviation
        Standard deviation of the regression's residuals.
    covariance
        Of the regression's coefficients, the gain first, shape (p, p).
    constants
        What one aircraft keeps from flight to flight beside the gain, by the fault that changes it.
    settled
        Whether the speed is measured, or turns had shown the wind before.
    largest
        Largest sum of drive² of its seconds.
    """

    basis: Basis
    shape: Shape
    gain: float
    others: Array
    variance: float
    error: float
    explained: float
    deviation: float
    covariance: Array
    start_s: int
    end_s: int
    constants: Mapping[str, Constant] = field(default_factory=dict)
    settled: bool = True
    largest: float = inf

    @property
    def apart(self) -> float:
        """Relative error of the regression's gain: large where another contribution is like the drive.

        A jackknife of few blocks is small by chance now and then. So it is never less than what the residuals
        of as many independent rows make of it.
        """
        if not self.gain or not self.explained > 0.0:
            return inf
        blocks = float(self.covariance[0, 0]) / self.gain**2
        rows = (1.0 / self.explained - 1.0) * MEAN_ROWS / (REFERENCE_S * RATE_HZ)
        return sqrt(max(blocks, rows))

    @property
    def speed(self) -> float:
        """Speed that is the unit of relative speeds, m/s."""
        return self.basis.speed


class Loss(NamedTuple):
    """A loss of effectiveness or a lag of an axis.

    Attributes
    ----------
    certain
        Whether it is certain; else the evidence is near that.
    since_s
        Flight second of its onset.
    evidence
        Logarithm of the evidence.
    lag_s
        Additional lag, if a slow servo explains more than a loss.
    kept, error
        Effectiveness since the onset, at that lag, over at most 20 judged seconds, and its standard error.
    grave
        Probability that it is a loss within the limit of an emergency.
    surfaces
        Of two mixed surfaces, the probability that the left, the right or both have lost effect, shape (3,);
        None without them.
    """

    certain: bool
    since_s: int
    evidence: float
    lag_s: float | None
    kept: float
    error: float
    grave: float
    surfaces: Array | None = None


@dataclass(frozen=True, slots=True)
class Second:
    """The results of one second.

    Attributes
    ----------
    end_s
        Flight second of its end.
    value, error
        Effectiveness over the last ten judged seconds, relative to the reference, and its standard error;
        None if they have insufficient evidence.
    loss
        The fault that the test suspects; None without one.
    shift, shift_error
        Mean of the unexplained response over the last three seconds, at the additional lag of the suspected
        fault, and what of it the errors of the coefficients and of sampling, and a manoeuvre, may make with
        95 %; None if it is not known.
    excluded
        Number of seconds over which a loss of 40 % is excluded by now, and was not before.
    """

    end_s: int
    value: float | None
    error: float
    loss: Loss | None
    shift: float | None
    shift_error: float
    excluded: int


class Constant(NamedTuple):
    """A constant and its standard error."""

    value: float
    error: float


def least_squares(design: Array, answer: Array) -> tuple[Array, float]:
    """Return the coefficients of a regression, shape (p,), and the variance that it leaves."""
    beta: Array = np.asarray(np.linalg.lstsq(design, answer, rcond=None)[0], dtype=np.float64)
    return beta, float(np.var(answer - design @ beta))


def without_blocks(design: Array, answer: Array) -> Array:
    """Return the coefficients of a regression without each of its blocks of rows, shape (blocks, p).

    Residuals of neighbouring rows are alike: whole blocks are left out, as long as a manoeuvre, not rows.
    """
    blocks = np.array_split(np.arange(len(answer)), REFERENCE_S // GUST_WINDOW_S)
    return np.array(
        [least_squares(np.delete(design, block, axis=0), np.delete(answer, block))[0] for block in blocks]
    )


def jackknife(parts: Array) -> Array:
    """Return the covariance of estimates by those without one block each, shape (blocks, p).

    References
    ----------
    B. Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", SIAM 1982, chapter 3.
    """
    away = parts - parts.mean(axis=0)
    return np.asarray((len(parts) - 1) / len(parts) * away.T @ away)


def constants(form: Form, speed: float, beta: Array, parts: Array) -> Mapping[str, Constant]:
    """Return the constants of a form, by the fault that changes them, with their jackknife errors.

    Parameters
    ----------
    form
        The regression.
    speed
        Reference speed, m/s.
    beta, parts
        Its coefficients, shape (p,), and those without each block, shape (blocks, p).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        whole, without = form.kept(beta, speed), [form.kept(part, speed) for part in parts]
        found = {}
        for fault, value in whole.items():
            error = float(np.sqrt(jackknife(np.array([[part[fault]] for part in without]))[0, 0]))
            if np.isfinite(value) and np.isfinite(error):
                found[fault] = Constant(float(value), error)
    return found


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over each second, shape (seconds,), and the ``rows`` of ``driven`` and ``raw`` that are good.

    ``columns`` are those of the drive and the nuisances, shape (seconds, p).
    """

    drive2: Array
    cross: Array
    answer2: Array
    drive: Array
    driven: Array
    raw: Array
    columns: Array
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
        driven = np.where(good, columns.drive, np.nan)
        raw = np.where(good, columns.answer - other, np.nan)
        drive, answer = self._drive.feed(driven, columns.unit), self._answer.feed(raw, columns.unit)
        shape = (-1, RATE_HZ)
        products = (drive * drive, drive * answer, answer * answer, drive, driven, raw)
        summed = [np.where(good, product, 0.0).reshape(shape).sum(axis=1) for product in products]
        drive2, cross, answer2, drive_sum, total, left = summed
        counts = good.reshape(shape).sum(axis=1)
        others = np.where(good[:, None], columns.others, 0.0).reshape(*shape, self._others.size)
        beside = np.column_stack([total, others.sum(axis=1)])
        return Sums(drive2, cross, answer2, drive_sum, total, left, beside, counts, (driven, raw, good))


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
        spread = WINDOW_DEVIATION**2 * np.minimum(WINDOW_S / n, 1.0)
        error = np.sqrt(own / reference.gain**2 + (k * reference.error) ** 2 + spread)
    known = (n > 1.0) & (total > 0.0)
    return np.where(known, k, np.nan), np.where(known, error, np.inf)
