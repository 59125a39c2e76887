"""The record of one flight for the comparison with others: sums of its windows, in bounded memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.normal_equations import row_length, sums_of_slots
from mavhums.health.own.equation import OwnEquation
from mavhums.health.own.grams import eliminated, full, packed
from mavhums.health.own.groups import Groups
from mavhums.health.own.terms import ANGLE, LOAD, ONE, PRESSURE, TERMS, Terms, Turned, terms
from mavhums.health.slots import Slots
from mavhums.health.windows import WINDOW_SLOTS
from mavhums.report.assessment import OwnRecord

__all__ = ["KEPT", "OwnSums"]

KEPT = ("sign", "speed", "acceleration", "load", "angle", "left")
"""The columns whose sums of products a record holds."""

_COLUMNS = [0, 1, 2, LOAD, ANGLE, len(TERMS)]

Array = NDArray[np.float64]


class OwnSums:
    """Collects the sums of one equation over one flight.

    Parameters
    ----------
    equation, actuator
        The equation, and the actuator of the flight.
    """

    width = len(TERMS)
    """Number of terms whose products are summed."""

    def __init__(self, equation: OwnEquation, actuator: Actuator) -> None:
        self._equation, self._actuator = equation, actuator
        self._turned = Turned()
        self._window: int | None = None
        self._row = np.zeros(row_length(self.width))
        self._groups = Groups(self.joined)
        self._span, self._samples = 0.0, 0
        self._pressure = False

    def feed(self, slots: Slots) -> None:
        """Process the samples of several slots."""
        told = terms(self._equation, self._actuator, slots, self._turned)
        if told is None:
            return
        time_s = slots.time_s[slots.judged]
        seen = np.isfinite(told.y) & np.isfinite(told.X[:, 1])
        told = self.expanded(told)
        rows = sums_of_slots(told.X, told.y, told.usable, slots.start)
        ends = np.append(slots.start[1:], time_s.size)
        for k, index in enumerate(slots.index.tolist()):
            if index // WINDOW_SLOTS != self._window:
                self._close()
                self._window = index // WINDOW_SLOTS
            self._row += rows[k]
            times = time_s[slots.start[k] : ends[k]][seen[slots.start[k] : ends[k]]]
            if times.size > 1:
                self._span += float(times[-1] - times[0])
                self._samples += times.size - 1

    def record(self) -> OwnRecord | None:
        """Return the record of the flight so far; None if it has no evidence for this equation."""
        groups = [*self._groups.parts]
        last = self._last()
        if last is not None:
            groups.append(last)
        if not groups or self._span <= 0.0 or self.rate_hz < self._equation.min_rate_hz:
            return None
        return OwnRecord(
            equation=self._equation.name,
            setup=self._setup(),
            rate_hz=float(f"{self.rate_hz:.3g}"),
            duration_s=round(self._span, 1),
            groups=tuple((float(count), *packed(gram)) for count, gram in groups),
        )

    @property
    def gap(self) -> str | None:
        """The reason for missing evidence; None if there is evidence, or if nothing is measured."""
        if not self._samples or self.record() is not None:
            return None
        needed = self._equation.min_rate_hz
        if self.rate_hz < needed:
            return f"the {self._equation.quantity} needs {needed:g} Hz, and the log has less"
        return f"the servo moved too little to show its {self._equation.quantity}"

    @property
    def rate_hz(self) -> float:
        """Rate of the samples that carry the left side."""
        return self._samples / self._span if self._span > 0.0 else 0.0

    def expanded(self, told: Terms) -> Terms:
        """Return the terms whose products are summed."""
        return told

    def in_window(self, gram: Array) -> Array:
        """Return a window's sums without its own offset."""
        self._pressure |= bool(gram[PRESSURE, PRESSURE] > 0.0)
        free = [ONE] if self._turned.source == "V3" else [ONE, PRESSURE]
        return eliminated(gram, free)[np.ix_(_COLUMNS, _COLUMNS)]

    def joined(self, sums: Array) -> Array:
        """Return a window's sums as they are added to those of other windows."""
        return sums

    def _setup(self) -> str:
        """Return the measurement set-up as text; only flights with the same set-up are compared."""
        angle = self._turned.source or "speed"
        return f"angle from {angle}, {'airspeed' if self._pressure else 'no airspeed'}"

    def _close(self) -> None:
        """End a window."""
        last = self._last()
        if last is not None:
            self._groups.add(*last)
        self._row[:] = 0.0

    def _last(self) -> tuple[int, Array] | None:
        """Return the sums of the open window, without its own offset."""
        if self._row[0] < 1.0:
            return None
        return int(self._row[0]), self.in_window(full(self._row, self.width))
