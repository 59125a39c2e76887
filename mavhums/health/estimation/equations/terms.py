"""Terms that several equations share.

Friction grows with the load: tooth and bearing forces press in proportion to the transmitted torque,

    T_f = T_c + μ·|τ|,

and oppose the motion. Against the load the motor gives τ·(1 + μ) + T_c, with it τ·(1 − μ) − T_c: without the
second part any healthy gear reads as worn under load. The term is the same in newton metres, amperes and
volts, for μ has no unit.
"""

from __future__ import annotations

import numpy as np

from mavhums.actuator.profile import Ema
from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import uniform_deviation
from mavhums.health.estimation.least_squares import Prior, solve, sums_of_slots
from mavhums.health.estimation.slots import Slots
from mavhums.health.estimation.thresholds import LOAD_LEAST_SAMPLES, LOAD_MEMORY_SLOTS, MOST_LOAD_FRICTION


def friction_with_load(speed: Array, load: Array) -> Array:
    """Return the term of μ, |τ|·sgn w, shape (n,)."""
    return np.asarray(np.abs(load) * np.sign(speed))


def load_friction_prior(ema: Ema) -> tuple[float, float]:
    """Return mean and standard deviation of μ as the profile knows it; unbounded where its term is zero."""
    if ema.load_friction is None:
        return MOST_LOAD_FRICTION / 2, uniform_deviation(MOST_LOAD_FRICTION)
    # A data sheet's uncertainty is two standard deviations.
    return ema.load_friction, np.inf if ema.load_friction == 0.0 else ema.load_friction_uncertainty / 2


class SlotLoad:
    """The load at each sample, from the linear balance of the slots before its own.

    The balance is y = X·β without the term of μ; the load is its part in some columns. A slot takes the
    coefficients of the slots before, which fade, so that nothing depends on how the log is cut into blocks.

    Parameters
    ----------
    prior
        Of the coefficients of X.
    columns
        Columns of X that make up the load.
    """

    def __init__(self, prior: Prior, columns: tuple[int, ...]) -> None:
        self._prior, self._columns = prior, list(columns)
        p = prior.mean.size
        self._sums = np.zeros(2 + p + p * (p + 1) // 2)
        self._both = np.zeros(2)

    def feed(self, slots: Slots, X: Array, y: Array, usable: Flags) -> Array:
        """Return the load at the judged samples, shape (n,), in the unit of y; NaN before it is known.

        ``X`` (n, p) has the sign of the speed in its first column.
        """
        rows = sums_of_slots(X, np.ascontiguousarray(y), usable, slots.start)
        ways = slots.sums(np.stack([usable & (X[:, 0] > 0), usable & (X[:, 0] < 0)], axis=1).astype(float))
        fade = np.exp(-1.0 / LOAD_MEMORY_SLOTS)
        before, both = np.empty_like(rows), np.empty_like(ways)
        for k in range(len(rows)):
            before[k], both[k] = self._sums, self._both
            self._sums, self._both = fade * self._sums + rows[k], fade * self._both + ways[k]
        coefficients = solve(before[:, None], self._prior.mean, self._prior.deviation)[0]
        coefficients[both.min(axis=1) < LOAD_LEAST_SAMPLES] = np.nan
        each = np.repeat(coefficients[:, self._columns], slots.count(), axis=0)
        load: Array = (X[:, self._columns] * each).sum(axis=1)
        return load
