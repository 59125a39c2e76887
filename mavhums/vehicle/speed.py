"""The airspeed of the aircraft, and whether it can be relied on.

The speed is that of the airspeed sensor, else of the wind triangle, else that over ground. A sensor whose
ratio to the wind triangle differs from that of the first minutes of the flight is doubted: the moment of a
control surface grows with the square of the speed, so a sensor that reads a quarter too much looks like a
loss of a third of the control effectiveness.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.wind import WindTriangle

__all__ = ["AirspeedCheck", "Speed"]

_ALIVE: Final = 5.0  # m/s
_ALIVE_S: Final = 20
_MOVING: Final = 8.0  # m/s
_EARLY_S: Final = 60
_DOUBTED: Final = ((5, 0.20), (10, 0.15), (30, 0.10))  # seconds, and mean change of the logarithm
_TRUSTED: Final = 0.08  # over the longest of them

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class AirspeedCheck:
    """Compares the airspeed sensor with the wind triangle, second by second.

    The limits let through the gusts of moderate turbulence, and notice a sensor that reads 20 % wrong within
    five seconds (closed-loop flights, see ``docs/control.md``).

    Examples
    --------
    >>> check = AirspeedCheck()
    >>> all(check.step(18.0, 18.5, settled=True) for _ in range(120))
    True
    >>> [check.step(23.0, 18.5, settled=True) for _ in range(6)][-1]
    False
    """

    def __init__(self) -> None:
        self._early: list[float] = []
        self._alive_s = 0
        self._offset: float | None = None
        self._recent: deque[float] = deque(maxlen=_DOUBTED[-1][0])
        self._doubted = False

    def step(self, sensed: float, triangle: float, *, settled: bool) -> bool:
        """Take the mean airspeeds of a second of flight, m/s; return whether the sensor is trusted.

        The first minute in which the wind triangle is settled gives the usual ratio. A sensor that was never
        alive is not doubted, for nothing relies on it.
        """
        if not triangle > _MOVING or not np.isfinite(sensed):
            return not self._doubted
        if sensed <= _ALIVE:
            self._doubted |= self._alive_s >= _ALIVE_S
            return not self._doubted
        self._alive_s += 1
        ratio = float(np.log(sensed / triangle))
        if self._offset is None:
            self._learn(ratio, settled)
        else:
            self._recent.append(ratio - self._offset)
            self._decide()
        return not self._doubted

    def _learn(self, ratio: float, settled: bool) -> None:
        if settled:
            self._early.append(ratio)
        if len(self._early) == _EARLY_S:
            self._offset = float(np.median(self._early))

    def _decide(self) -> None:
        changes = np.array(self._recent)
        known = [(s, limit) for s, limit in _DOUBTED if len(changes) >= s]
        if any(abs(changes[-s:].mean()) > limit for s, limit in known):
            self._doubted = True
        elif len(changes) == self._recent.maxlen and abs(changes.mean()) < _TRUSTED:
            self._doubted = False


class Speed:
    """Follows the airspeed of one vehicle, from whole seconds of signals."""

    def __init__(self) -> None:
        self._wind = WindTriangle()
        self._check = AirspeedCheck()

    def feed(self, signals: dict[str, Array]) -> tuple[Array, Flags, Array]:
        """Return the airspeed, m/s, whether it can be relied on, and where it comes from, each (n,).

        It comes from the sensor (0), from the wind triangle (1) or is the speed over ground (2).

        ``signals`` are whole seconds, shape (k, RATE_HZ, columns).
        """
        triangle, settled = self._triangle(signals)
        sensed, ground = (signals[name][:, :, 0] for name in ("airspeed", "groundspeed"))
        trusted = [
            self._check.step(_mean(one), _mean(other), settled=is_settled)
            for one, other, is_settled in zip(sensed, triangle, settled, strict=True)
        ]
        source = np.where(sensed > _ALIVE, 0, np.where(np.isfinite(triangle), 1, 2))
        speed = np.choose(source, [sensed, triangle, ground])
        return (
            speed.ravel(),
            np.repeat(np.array(trusted, dtype=bool), RATE_HZ),
            source.ravel().astype(np.float64),
        )

    def _triangle(self, signals: dict[str, Array]) -> tuple[Array, list[bool]]:
        """Return the airspeed without the sensor, shape (k, RATE_HZ), and whether it is settled, of k."""
        winds, settled = [], []
        for velocity, attitude in zip(signals["velocity"][:, 0], signals["attitude"][:, 0], strict=True):
            self._wind.step(velocity, float(attitude[2]))
            winds.append(self._wind.wind)
            settled.append(self._wind.is_settled)
        relative = signals["velocity"] - np.array(winds)[:, None, :]
        return np.hypot(relative[:, :, 0], relative[:, :, 1]), settled


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan
