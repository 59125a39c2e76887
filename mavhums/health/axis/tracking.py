"""Residual models: tracking of the demanded attitude, and the side force in coordinated flight.

The closed-loop responses are ArduPlane's usual ones; the reference absorbs differences.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from mavhums.health.axis.filters import Following, Tail
from mavhums.vehicle.flight import Rows
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["PitchTracking", "RollTracking", "SideForce"]

_FREE: Final = 1e9
_ROLLS_RAD_S: Final = float(np.radians(45))
_PITCH_DELAY_S: Final = 0.6
_NOSE_LOW_RAD: Final = float(np.radians(3))
_SLOW: Final = 0.95
_SPEED_S: Final = 60

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class RollTracking:
    """``φ − (demanded φ through a second order of 2.5 rad/s)``, with a learned offset.

    A reversal of 110° takes an aircraft seconds, and a calm beginning does not tell how many: it may follow
    at 45°/s as well.
    """

    kind: Literal["mean", "rms"] = "rms"
    floor = 0.033  # rad
    spreads: tuple[float, ...] = (0.1,)

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._responses = Following(2.5), Following(2.5, _ROLLS_RAD_S)

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the offset's regressor, the roll residual, and the mask of flight rows with both."""
        if rows.fresh:
            self._begin()
        expected = [rows.roll_demand, *(response.feed(rows.roll_demand) for response in self._responses)]
        answer = rows.roll - np.clip(rows.roll, np.fmin.reduce(expected), np.fmax.reduce(expected))
        good = rows.flying & np.isfinite(rows.roll_demand) & np.isfinite(answer)
        return np.ones((len(rows), 1)), answer, good


class _OwnSpeed:
    """The median airspeed of the first minute of flight."""

    def __init__(self) -> None:
        self._speeds: list[Array] = []
        self.value = np.nan

    def feed(self, rows: Rows) -> Array:
        """Return the median up to each row's second, shape (n,), m/s.

        It is found second by second: a value that later seconds of the same block have changed would make
        the verdict depend on how the log is divided into blocks.
        """
        values = np.empty(rows.seconds)
        seconds = zip(rows.speed.reshape(-1, RATE_HZ), rows.flying.reshape(-1, RATE_HZ), strict=True)
        for k, (speed, flying) in enumerate(seconds):
            if len(self._speeds) < _SPEED_S and flying.any():
                self._speeds.append(speed[flying])
                self.value = float(np.nanmedian(np.concatenate(self._speeds)))
            values[k] = self.value
        return np.repeat(values, RATE_HZ)


class PitchTracking:
    """``θ − (demanded θ, 0.6 s later, through a second order of 4 rad/s)``, less its part in turns.

    If the nose is below the demand and the aircraft is slow, it stalls or has lost its engine: this is
    no evidence against the elevator.
    """

    kind: Literal["mean", "rms"] = "rms"
    floor = 0.025  # rad
    spreads: tuple[float, ...] = (0.1, 0.1)

    def __init__(self) -> None:
        self._begin()
        self._own = _OwnSpeed()

    def _begin(self) -> None:
        self._demand = Following(4.0)
        self._late = Tail(1, round(_PITCH_DELAY_S * RATE_HZ))

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the regressors 1 and sin² φ, the pitch residual, and the mask of flight rows with both."""
        if rows.fresh:
            self._begin()
        late = self._late.feed(self._demand.feed(rows.pitch_demand)[:, None])[: len(rows), 0]
        answer = rows.pitch - late
        own = self._own.feed(rows)
        sinking = (rows.pitch < rows.pitch_demand - _NOSE_LOW_RAD) & (rows.speed < _SLOW * own)
        good = rows.flying & np.isfinite(rows.pitch_demand) & np.isfinite(answer) & ~sinking
        turning = np.nan_to_num(np.sin(rows.roll)) ** 2
        return np.column_stack([np.ones(len(rows)), turning]), answer, good


class SideForce:
    """The side force without its part in turns, as caused by a deflected rudder or a skid."""

    kind: Literal["mean", "rms"] = "mean"
    floor = 0.15  # m/s²
    spreads: tuple[float, ...] = (_FREE, 5.0, 5.0)

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        """Return the regressors 1, sin φ and yaw rate, the side force, and the mask of usable flight rows."""
        columns = np.column_stack([np.ones(len(rows)), np.sin(rows.roll), rows.yaw_rate])
        good = rows.flying & np.isfinite(columns).all(axis=1) & np.isfinite(rows.side_force)
        return np.nan_to_num(columns), np.nan_to_num(rows.side_force), good
