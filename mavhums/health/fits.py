"""Fits of the equations to an actuator's slots: per window, over the flight so far, and in total."""

from __future__ import annotations

from collections.abc import Collection
from importlib import import_module
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health import equations
from mavhums.health.least_squares import Fit
from mavhums.health.motion import Motion
from mavhums.health.normal_equations import row_length, sums_of_slots
from mavhums.health.slots import Slots
from mavhums.health.windows import Windows

__all__ = ["Fits"]

_GROUPS = 32

Array = NDArray[np.float64]


def _equation(name: str) -> ModuleType:
    return import_module(f"{equations.__name__}.{name}")


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
        self._equations = {name: _equation(name) for name in sorted(names)}
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
            X, y, usable = equation.terms(self._actuator, motion)
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
            name: Fit(sums[:, :, self._columns[name]], self._priors[name], equation.TERMS)
            for name, equation in self._equations.items()
        }

    def _add(self, row: Array) -> None:
        if self._slots == _GROUPS * self._of_group:
            self._groups[: _GROUPS // 2] = self._groups[::2] + self._groups[1::2]
            self._groups[_GROUPS // 2 :] = 0.0
            self._of_group *= 2
        self._groups[self._slots // self._of_group] += row
        self._slots += 1
