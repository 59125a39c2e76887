"""The record of one flight for the power that a servo takes from its supply.

    P = ρ·T² + w·T + P₀        T = T_c·sgn(w) + b·w + J·dw/dt + h·q·d + c

The power is linear in products of the torque's terms. The sums of products of these products therefore hold
all that least squares needs, whatever the individual's coefficients are. P₀ is free in each window of 10 s
and leaves the sums there. c, the slow part of the load, multiplies terms that depend on the coefficients; it
leaves the sums in :mod:`~mavhums.health.own.power_fit`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.health.own.grams import eliminated
from mavhums.health.own.record import OwnSums
from mavhums.health.own.terms import LOAD, PRESSURE, Terms

__all__ = ["COLUMNS", "LINEAR", "NAME", "QUADRATIC", "WEAR", "PowerSums"]

NAME = "own_power"

_PRODUCTS = ((0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3))

LINEAR = (0, 1, 2, 3)
"""Columns of sgn(w), w, dw/dt and q·d."""

WEAR = (4, 5, 6)
"""Columns of the products of sgn(w) with w, dw/dt and q·d."""

QUADRATIC = (7, 8, 9, 10, 11, 12)
"""Columns of the products of w, dw/dt and q·d: w², w·dw/dt, w·q·d, (dw/dt)², dw/dt·q·d, (q·d)²."""

COLUMNS = len(LINEAR) + len(_PRODUCTS) + 1
"""Number of columns of a record; the last is the power."""

_FIRST, _SECOND = ([pair[side] for pair in _PRODUCTS] for side in (0, 1))

Array = NDArray[np.float64]


class PowerSums(OwnSums):
    """Collects the sums of the power over one flight.

    Parameters
    ----------
    equation, actuator
        The equation, and the actuator of the flight.
    """

    width = COLUMNS

    @property
    def gap(self) -> str | None:
        """The reason for missing evidence; None if there is evidence, or if nothing is measured."""
        gap = super().gap
        if gap is None or self._pressure or self.rate_hz < self._equation.min_rate_hz:
            return gap
        return f"the {self._equation.quantity} needs the airspeed, and the log has none"

    def expanded(self, told: Terms) -> Terms:
        """Return the products of the torque's terms at the samples with a known airspeed."""
        factors = told.X[:, [0, 1, 2, LOAD]]
        known = told.X[:, PRESSURE] > 0.0
        self._pressure |= bool(known.any())
        products = factors[:, _FIRST] * factors[:, _SECOND]
        X = np.concatenate([factors, products, np.ones((len(factors), 1))], axis=1)
        return Terms(np.ascontiguousarray(X), told.y, told.usable & known)

    def in_window(self, gram: Array) -> Array:
        """Return a window's sums without its own P₀."""
        one = self.width - 1
        kept = [*range(one), self.width]
        return eliminated(gram, [one])[np.ix_(kept, kept)]

    def joined(self, sums: Array) -> Array:
        """Return a window's sums without its linear terms: the windows of a long part differ in their c."""
        return eliminated(sums, LINEAR)
