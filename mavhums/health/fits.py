"""Fit the equations to an actuator's slots: in each window, over the flight so far, and over all of it."""

from __future__ import annotations

from collections.abc import Collection
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.equations import brief, gear, supply, torque, voltage
from mavhums.health.least_squares import Fit, moments
from mavhums.health.motion import Motion
from mavhums.health.slots import Slots
from mavhums.health.windows import Windows

__all__ = ["Fits"]

_EQUATIONS: dict[str, ModuleType] = {
    "torque": torque,
    "brief": brief,
    "voltage": voltage,
    "gear": gear,
    "supply": supply,
}
_GROUPS = 32

Array = NDArray[np.float64]


class Fits:
    """The fits of some equations for one actuator, in memory that does not grow.

    Parameters
    ----------
    actuator
        With the constants that the equations take.
    names
        Of the equations.
    """

    def __init__(self, actuator: Actuator, names: Collection[str]) -> None:
        self._tracks = {name: _Track(actuator, _EQUATIONS[name]) for name in sorted(names)}

    def feed(self, slots: Slots, motion: Motion) -> tuple[dict[str, Fit], dict[str, Fit]]:
        """Return the fits of the windows that end with each slot, and of all slots until then."""
        windows, flight = {}, {}
        for name, track in self._tracks.items():
            windows[name], flight[name] = track.feed(slots, motion)
        return windows, flight

    def whole(self) -> dict[str, Fit]:
        """Return the fits of the whole flight so far, each one window."""
        return {name: track.whole() for name, track in self._tracks.items()}


class _Track:
    """One equation's sums: of the window, of the flight, and of the flight in up to 32 equal parts."""

    def __init__(self, actuator: Actuator, equation: ModuleType) -> None:
        self._actuator = actuator
        self._equation = equation
        self._prior = equation.prior(actuator)
        p = self._prior.mean.size
        columns = 2 + p + p * (p + 1) // 2
        self._windows = Windows(columns)
        self._sofar = np.zeros(columns)
        self._groups = np.zeros((_GROUPS, columns))
        self._of_group = 1
        self._slots = 0

    def feed(self, slots: Slots, motion: Motion) -> tuple[Fit, Fit]:
        sums = slots.sums(moments(*self._equation.terms(self._actuator, motion)))
        sofar = np.cumsum(np.vstack([self._sofar, sums]), axis=0)[1:]
        self._sofar = sofar[-1]
        for row in sums:
            self._add(row)
        return Fit(self._windows.feed(slots.index, sums), self._prior), Fit(sofar[:, None], self._prior)

    def whole(self) -> Fit:
        return Fit(self._groups[None], self._prior)

    def _add(self, row: Array) -> None:
        if self._slots == _GROUPS * self._of_group:
            self._groups[: _GROUPS // 2] = self._groups[::2] + self._groups[1::2]
            self._groups[_GROUPS // 2 :] = 0.0
            self._of_group *= 2
        self._groups[self._slots // self._of_group] += row
        self._slots += 1
