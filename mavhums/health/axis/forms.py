"""The regressions of the three axes.

Speeds enter relative to the reference speed. Roll: quasi-steady rolling against roll damping. Pitch: angular
acceleration, with the accelerometer as angle of attack. Yaw: the side force from a rudder's sideslip.

References
----------
V. Klein, E. A. Morelli, "Aircraft System Identification", AIAA 2006, chapters 3 and 5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.vehicle.flight import Rows

__all__ = ["PitchForm", "RollForm", "YawForm"]

Array = NDArray[np.float64]


class RollForm:
    """``p = K·v·δ + b·v + c·r``: roll rate p, relative airspeed v, demand δ by the ailerons, yaw rate r."""

    axis = "roll"
    nuisances = 2
    derivative = False

    def drive(self, demand: Array, relative: Array) -> Array:
        """Return v·δ."""
        return relative * demand

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v for the trim, and the yaw rate: in a turn the outer wing is faster and lifts more."""
        return np.column_stack([relative, rows.yaw_rate])

    def answer(self, rows: Rows) -> Array:
        """Return the roll rate."""
        return rows.roll_rate

    def possible(self, others: Array) -> bool:
        """Return True: no sign is certain."""
        return True

    def kept(self, beta: Array, speed: float) -> dict[str, float]:
        """Return the demand that keeps the wings level, −b/K."""
        return {"hard_over": -beta[1] / beta[0]}


class PitchForm:
    """``q̇ = K·v²·δ + a·v² + b·v·q + c·n``: pitch rate q, load factor n for the angle of attack."""

    axis = "pitch"
    nuisances = 3
    derivative = True

    def drive(self, demand: Array, relative: Array) -> Array:
        """Return v²·δ."""
        return relative**2 * demand

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v² for the trim, v·q for the damping, n for the stability."""
        return np.column_stack([relative**2, relative * rows.pitch_rate, rows.load])

    def answer(self, rows: Rows) -> Array:
        """Return the pitch rate; its rate of change is the response."""
        return rows.pitch_rate

    def possible(self, others: Array) -> bool:
        """Return whether pitching is damped: else the autopilot's feedback was found, not the aircraft."""
        return bool(others[1] < 0.0)

    def kept(self, beta: Array, speed: float) -> dict[str, float]:
        """Return the steady load factor by the full demand, over the square of the speed, |K/c|/V²."""
        return {"manoeuvre": abs(beta[0] / beta[3]) / speed**2}


class YawForm:
    """``a = K·v²·δ + …``: side force a, without the parts of aileron, trim, yaw rate, roll rate and bank."""

    axis = "yaw"
    nuisances = 5
    derivative = False

    def drive(self, demand: Array, relative: Array) -> Array:
        """Return v²·δ."""
        return relative**2 * demand

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v²·δ of the ailerons, v², v·r, v·p and sin φ."""
        square = relative**2
        aileron = np.nan_to_num(demands["roll"])
        rates = (relative * rows.yaw_rate, relative * rows.roll_rate)
        return np.column_stack([square * aileron, square, *rates, np.sin(rows.roll)])

    def answer(self, rows: Rows) -> Array:
        """Return the side force."""
        return rows.side_force

    def possible(self, others: Array) -> bool:
        """Return True: no sign is certain."""
        return True

    def kept(self, beta: Array, speed: float) -> dict[str, float]:
        """Return nothing: beside the gain itself, no constant of yaw is known well enough."""
        return {}
