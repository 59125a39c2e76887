"""Airspeed without a sensor: the wind that makes the ground velocities of all headings consistent."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["WindTriangle"]

_MEMORY_S: Final = 60.0
_LEAST_SPEED: Final = 5.0  # over ground, m/s: the heading of a slow aircraft does not show the wind
_GUESS: Final = (15.0, 0.0, 0.0)  # airspeed and wind to the north and east, m/s
_MOST: Final = 1e4
_SETTLED: Final = 0.06  # variance of the airspeed, in that of one ground velocity: after turns by 90°

Array = NDArray[np.float64]


class WindTriangle:
    """Follows airspeed and wind by recursive least squares, one step a second.

    ``velocity = airspeed · (cos heading, sin heading) + wind``, with a memory of one minute.

    Attributes
    ----------
    wind
        North and east, m/s.
    """

    def __init__(self) -> None:
        self._state = np.array(_GUESS)
        self._spread = np.diag([2500.0, 900.0, 900.0])

    @property
    def is_settled(self) -> bool:
        """Whether the headings so far have told airspeed from wind."""
        return bool(self._spread[0, 0] <= _SETTLED)

    @property
    def wind(self) -> Array:
        """The present estimate of the wind, to the north and east, m/s."""
        return self._state[1:]

    def step(self, velocity: Array, heading: float) -> None:
        """Take a ground velocity (2,), m/s, and the heading, rad; ignore values that are not finite."""
        if not (np.isfinite(velocity).all() and np.isfinite(heading)) or np.hypot(*velocity) < _LEAST_SPEED:
            return
        h = np.array([[np.cos(heading), 1.0, 0.0], [np.sin(heading), 0.0, 1.0]])
        spread = np.minimum(self._spread * np.exp(1.0 / _MEMORY_S), _MOST)
        across = spread @ h.T
        gain = across @ np.linalg.inv(h @ across + np.eye(2))
        self._state = self._state + gain @ (velocity - h @ self._state)
        self._spread = spread - gain @ h @ spread
