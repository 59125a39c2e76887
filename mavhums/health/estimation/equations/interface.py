"""The two kinds of equations, each linear in its coefficients, and the friction by load in both.

An :class:`Equation` rests on the constants of a data sheet. An :class:`OwnEquation` needs none:

    y = wear·sgn(w) + b·w + J·dw/dt + h·q·d + o

w is the servo's speed, q the dynamic pressure, d the surface's angle, and o an offset that is free in each
window of 10 s: it absorbs the trim load and slow changes. b, J and h are properties of the individual.
They are learned once from its own flights and then fixed; only ``wear`` is estimated in each flight.

Friction grows with the load: tooth and bearing forces press in proportion to the transmitted torque,

    T_f = T_c + μ·|τ|,

and oppose the motion. Against the load the motor gives τ·(1 + μ) + T_c, with it τ·(1 − μ) − T_c: without the
second part any healthy gear reads as worn under load. The term is the same in newton metres, amperes and
volts, for μ has no unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mavhums.actuator.profile import Actuator, Ema
from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import uniform_deviation
from mavhums.health.estimation.least_squares import Prior, solve, sums_of_slots
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import Slots
from mavhums.health.estimation.thresholds import (
    BASELINE_FLIGHTS,
    LEAST_SAMPLES,
    LOAD_MEMORY_SLOTS,
    MOST_LOAD_FRICTION,
)


@dataclass(frozen=True, slots=True)
class Equation:
    """One equation with the constants of a data sheet.

    Attributes
    ----------
    name
        Name by which detectors read its fit.
    terms
        Names of its p terms.
    prior
        Returns the prior of the coefficients.
    rows
        Returns the terms (n, p), the left side (n,) and the mask of usable samples (n,).
    """

    name: str
    terms: tuple[str, ...]
    prior: Callable[[Actuator], Prior]
    rows: Callable[[Actuator, Motion], tuple[Array, Array, Flags]]


class ServoSpeed(NamedTuple):
    """A servo's speed, rad/s of the measured shaft, and the threshold from which it counts as moving."""

    rad_s: Array
    moving_rad_s: float


@dataclass(frozen=True, slots=True)
class OwnEquation:
    """One own-scale equation.

    Attributes
    ----------
    name
        Name under which flights store its sums.
    fault
        Name of the indicator.
    quantity, unit
        Quantity and unit of the wear coefficient.
    inspect
        The parts that a maintainer should inspect.
    cause
        The possible causes of a change, as far as the data show.
    left
        Returns the left side at all samples, shape (n,), NaN where it is not measured.
    speed
        Returns the speed at all samples.
    min_flights
        Number of flights that the baseline needs.
    by_activity
        Whether the wear coefficient depends on how fast the commands change: a flight is then compared with
        the baseline at its own acceleration.
    blurs
        Whether a grave fault makes the quantity as uncertain as it makes it large. A flight's error then
        counts at most as threefold that of the baseline.
    """

    name: str
    fault: str
    quantity: str
    unit: str
    inspect: str
    cause: str
    left: Callable[[Actuator, Slots], Array]
    speed: Callable[[Actuator, Slots], ServoSpeed]
    min_flights: int = BASELINE_FLIGHTS
    by_activity: bool = False
    blurs: bool = False


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
        coefficients[both.min(axis=1) < 2.0 * LEAST_SAMPLES] = np.nan
        each = np.repeat(coefficients[:, self._columns], slots.count(), axis=0)
        load: Array = (X[:, self._columns] * each).sum(axis=1)
        return load
