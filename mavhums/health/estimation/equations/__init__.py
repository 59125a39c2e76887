"""The equations of an actuator's samples, and their fits; detectors read the coefficients.

:data:`EQUATIONS` need the constants of a data sheet, :data:`OWN_EQUATIONS` none. A test holds both against
the modules of this folder.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array
from mavhums.health.estimation.equations import data_sheet, own_scale
from mavhums.health.estimation.equations.interface import Equation, OwnEquation
from mavhums.health.estimation.least_squares import Fit, row_length, sums_of_slots
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import Slots, Windows

EQUATIONS: tuple[Equation, ...] = (
    data_sheet.GEAR,
    data_sheet.TORQUE,
    data_sheet.TORQUE_PER_SAMPLE,
    data_sheet.VOLTAGE,
    data_sheet.SUPPLY,
)

OWN_EQUATIONS: tuple[OwnEquation, ...] = (
    own_scale.CURRENT,
    own_scale.VOLTAGE,
    own_scale.TRACKING,
)
"""The most informative first: the first one of which a flight has a record is compared."""

STROKE_EQUATIONS: tuple[OwnEquation, ...] = (own_scale.TWO_WAYS, own_scale.ROUGHNESS, own_scale.RIPPLE)
"""Of strokes at constant commanded speed: indicators beside the others."""

_GROUPS = 32  # parts of a flight, 16 at least once it is long: their scatter is known to 18 %


class Fits:
    """The fits of several equations for one actuator, in bounded memory.

    A row of sums holds the sums of every equation. Rows are kept for each slot of the window, for the flight,
    and for up to 32 equal parts of the flight.

    Parameters
    ----------
    actuator
        The actuator, with the constants that the equations use.
    names
        Names of the equations.
    """

    def __init__(self, actuator: Actuator, names: Collection[str]) -> None:
        self._actuator = actuator
        self._equations = {one.name: one for one in EQUATIONS if one.name in names}
        self._priors = {name: equation.prior(actuator) for name, equation in self._equations.items()}
        ends = np.cumsum([0, *(row_length(prior.mean.size) for prior in self._priors.values())]).tolist()
        self._columns = dict(zip(self._equations, map(slice, ends, ends[1:]), strict=False))
        self._windows = Windows(ends[-1])
        self._flight = np.zeros((1, ends[-1]))
        self._groups = np.zeros((_GROUPS, ends[-1]))
        self._of_group = 1
        self._slots = 0

    def feed(self, slots: Slots, motion: Motion) -> tuple[dict[str, Fit], dict[str, Fit]]:
        """Return the fits of the windows that end with each slot, and of all slots up to it."""
        sums = np.empty((slots.index.size, self._flight.size))
        for name, equation in self._equations.items():
            X, y, usable = equation.rows(self._actuator, motion)
            sums[:, self._columns[name]] = sums_of_slots(X, np.ascontiguousarray(y), usable, slots.start)
        flight = np.cumsum(np.concatenate([self._flight, sums]), axis=0)
        self._flight = flight[-1:]
        for row in sums:
            self._add(row)
        return self._fit(self._windows.feed(slots.index, sums)), self._fit(flight[1:, None])

    def whole(self) -> dict[str, Fit]:
        """Return the fits of the whole flight so far, each as one window."""
        return self._fit(self._groups[None].copy())

    def _fit(self, sums: Array) -> dict[str, Fit]:
        return {
            name: Fit(sums[:, :, self._columns[name]], self._priors[name], equation.terms)
            for name, equation in self._equations.items()
        }

    def _add(self, row: Array) -> None:
        if self._slots == _GROUPS * self._of_group:
            # Full: neighbours are joined, so that memory stays the same for any length of flight.
            self._groups[: _GROUPS // 2] = self._groups[::2] + self._groups[1::2]
            self._groups[_GROUPS // 2 :] = 0.0
            self._of_group *= 2
        self._groups[self._slots // self._of_group] += row
        self._slots += 1
