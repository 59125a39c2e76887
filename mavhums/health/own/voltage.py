"""The voltage equation of one flight, as sums: resistance, back-EMF constant and drop of the servo's motor.

    V4 = R·V5 + k_e·w + V_d·sgn(V5) + c

w is the rotor's speed. The drop of brushes or dead time has a column of its own: without it, it would appear
as resistance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.normal_equations import row_length, sums_of_slots
from mavhums.health.own.grams import eliminated, full, packed
from mavhums.health.own.groups import Groups
from mavhums.health.own.peaks import Peak
from mavhums.health.slots import Slots
from mavhums.health.windows import WINDOW_SLOTS
from mavhums.report.assessment import OwnRecord

__all__ = ["NAME", "VoltageSums"]

NAME = "own_voltage"

_V4, _V5, _V7 = column("V4"), column("V5"), column("V7")
_TERMS = 4
_LEFT_OUT = [3]
_RAD_S = np.pi / 30

Array = NDArray[np.float64]


class VoltageSums:
    """Collects the sums of the voltage equation over one flight.

    Parameters
    ----------
    actuator
        The actuator of the flight.
    """

    def __init__(self, actuator: Actuator) -> None:
        self._motor_side = actuator.esc_side == "motor"
        self._supply_v = actuator.known_supply_v
        self._peak_a, self._peak_v = Peak(), Peak()
        self._groups = Groups()
        self._row = np.zeros(row_length(_TERMS))
        self._window: int | None = None
        self._first_s = self._last_s = np.nan
        self._samples = 0

    def feed(self, slots: Slots) -> None:
        """Process the samples of several slots."""
        values, time_s = slots.values[slots.judged], slots.time_s[slots.judged]
        volts, current = np.ascontiguousarray(values[:, _V4]), values[:, _V5]
        terms = (current, values[:, _V7] * _RAD_S, np.sign(current), np.ones(len(current)))
        X = np.stack(terms, axis=1)
        usable = np.isfinite(X).all(axis=1) & np.isfinite(volts) & self._motor_side
        if not usable.any():
            return
        self._peak_a.feed(current[usable])
        self._peak_v.feed(volts[usable])
        used_s = time_s[usable]
        self._samples += used_s.size
        self._first_s = float(np.nanmin([self._first_s, used_s[0]]))
        self._last_s = float(used_s[-1])
        rows = sums_of_slots(X, volts, usable, slots.start)
        for row, index in zip(rows, slots.index.tolist(), strict=True):
            if index // WINDOW_SLOTS != self._window:
                self._close()
                self._window = index // WINDOW_SLOTS
            self._row += row

    @property
    def gap(self) -> None:
        """None: a motor that cannot be identified is no reason for a verdict."""
        return

    def record(self) -> OwnRecord | None:
        """Return the record of the flight so far; None if it has no evidence for the equation."""
        groups = [*self._groups.parts, *self._open()]
        duration_s = self._last_s - self._first_s
        if not groups or not duration_s > 0.0:
            return None
        return OwnRecord(
            equation=NAME,
            setup="V4, V5 and V7 at the motor",
            rate_hz=float(f"{self._samples / duration_s:.3g}"),
            duration_s=round(duration_s, 1),
            peak_a=self._peak_a.interval,
            peak_v=float(f"{self._peak_v.value:.4g}"),
            supply_v=self._supply_v,
            groups=tuple((float(count), *packed(gram)) for count, gram in groups),
        )

    def _close(self) -> None:
        for part in self._open():
            self._groups.add(*part)
        self._row[:] = 0.0

    def _open(self) -> list[tuple[int, Array]]:
        """Return the sums of the open window, without its own offset."""
        if self._row[0] < 1.0:
            return []
        gram = eliminated(full(self._row, _TERMS), _LEFT_OUT)
        kept = [0, 1, 2, _TERMS]
        return [(int(self._row[0]), gram[np.ix_(kept, kept)])]
