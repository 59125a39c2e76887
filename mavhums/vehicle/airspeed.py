"""The airspeed: as the vehicle reports it, from the wind triangle, and whether the sensor can be relied on.

The wind triangle gives the airspeed without a sensor: the wind that makes the ground velocities of all
headings consistent. A pitot tube that reads wrong would look like a loss of control: the response to a
surface grows with the square of the airspeed. So the sensor is compared with the triangle.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.log import Table
from mavhums.vehicle.formats import by_vehicle, messages_of
from mavhums.vehicle.grid import RATE_HZ

AIRSPEED_MESSAGES: Final = messages_of("sensed airspeed")

_MEMORY_S: Final = 60.0
"""Memory of the wind: longer lags a wind that changes with altitude, shorter forgets between two turns."""
_LEAST_SPEED_M_S: Final = 5.0  # over ground: the heading of a slow aircraft does not show the wind
_GUESS_M_S: Final = (15.0, 0.0, 0.0)  # airspeed and wind to the north and east, before the first velocity
_GUESS_VARIANCES: Final = (2500.0, 900.0, 900.0)  # (m/s)²: any airspeed and wind that an aircraft meets
_LEAPS_M_S: Final = 20.0  # over ground, in a second: a jammed or newly aligned receiver, not a turn
_DRIFT_VARIANCES: Final = (25.0, 25.0, 25.0, 1.0)
"""Of a boat's current, slip and compass error, in that of one velocity across its heading, 0.2 m/s: 1 m/s,
1 m and 0.2 rad."""
_SETTLED_VARIANCE: Final = 0.06
"""Variance of the airspeed, in that of one ground velocity, from which it is settled: after turns by 90°."""

_ALIVE_M_S: Final = 5.0  # a pitot tube that reads less in flight is covered or absent
_ALIVE_S: Final = 20  # a sensor alive for as long is one that may fail
_FROZEN_M_S: Final = 2.0  # a sensor that repeats one number over such a range of airspeeds measures nothing
_MOVING_M_S: Final = 8.0  # below, wind and ground speed say too little about the ratio
_EARLY_S: Final = (30, 60)
"""Seconds of settled flight whose median ratio is the sensor's usual one: from so many on, and at most."""
_DOUBTED: Final = ((5, 0.20), (10, 0.15), (30, 0.10))
"""Seconds, and the mean change of the ratio's logarithm over them from which the sensor is doubted: through
these go the gusts of moderate turbulence, not a sensor that reads 20 % wrong (closed-loop flights)."""
_TRUSTED: Final = 0.08  # over the longest of them: below the limit, so that trust does not flicker

_STALE_US: Final = 3_000_000  # an older report is not the airspeed of now
_KEPT_US: Final = 60_000_000  # samples of actuators come late by less


class _LeastSquares:
    """Recursive least squares. What is not shown, as the airspeed on a straight leg, is not forgotten."""

    def __init__(self, guess: Sequence[float], variances: Sequence[float]) -> None:
        self.values: Array = np.array(guess)
        self.spread: Array = np.diag(variances)

    def step(self, rows: Array, measured: Array) -> None:
        """Take m equations ``rows @ values = measured``, (m, n) and (m,), each with a variance of 1."""
        across = self.spread @ rows.T
        shown = across @ np.linalg.solve(rows @ across, across.T)
        spread = self.spread + (np.exp(1.0 / _MEMORY_S) - 1.0) * shown
        across = spread @ rows.T
        gain = across @ np.linalg.inv(rows @ across + np.eye(len(rows)))
        self.values = self.values + gain @ (measured - rows @ self.values)
        self.spread = spread - gain @ rows @ spread


class WindTriangle:
    """Follows airspeed and wind by recursive least squares, one step a second.

    ``velocity = airspeed · (cos heading, sin heading) + wind``, with a memory of one minute.
    """

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._fit = _LeastSquares(_GUESS_M_S, _GUESS_VARIANCES)
        self._velocity = np.full(2, np.nan)

    @property
    def is_settled(self) -> bool:
        """Whether the headings so far separate airspeed from wind."""
        return bool(self._fit.spread[0, 0] <= _SETTLED_VARIANCE)

    @property
    def wind(self) -> Array:
        """The present estimate of the wind, to the north and east, m/s."""
        return self._fit.values[1:]

    def step(self, velocity: Array, heading: float) -> None:
        """Take a ground velocity (2,), m/s, and the heading, rad; ignore values that are not finite.

        A velocity that leaps begins the estimate anew.
        """
        if (
            not (np.isfinite(velocity).all() and np.isfinite(heading))
            or np.hypot(*velocity) < _LEAST_SPEED_M_S
        ):
            return
        rows = np.array([[np.cos(heading), 1.0, 0.0], [np.sin(heading), 0.0, 1.0]])
        if np.hypot(*(velocity - self._velocity)) > _LEAPS_M_S:
            self._begin()
        self._velocity = velocity
        self._fit.step(rows, velocity)


class Current:
    """Follows the current that a boat drifts with, by recursive least squares, one step a second.

    Whatever its speed through the water, that is along the heading. Across it, the boat moves with the
    current, out of its turns in proportion to the yaw rate, and by the compass's error in proportion to its
    speed through the water.

    Examples
    --------
    >>> current = Current()
    >>> for heading in np.linspace(0.0, 3.0, 60):
    ...     current.step(2.0 * np.array([np.cos(heading), np.sin(heading)]) + [0.3, -0.2], heading, 0.05)
    >>> current.velocity.round(2).tolist()
    [0.3, -0.2]
    """

    def __init__(self) -> None:
        self._fit = _LeastSquares((0.0, 0.0, 0.0, 0.0), _DRIFT_VARIANCES)

    @property
    def velocity(self) -> Array:
        """The present estimate of the current, to the north and east, m/s."""
        return self._fit.values[:2]

    def step(self, velocity: Array, heading: float, yaw_rate: float) -> None:
        """Take a ground velocity (2,), m/s, heading, rad, and yaw rate, rad/s; ignore what is not finite."""
        along, across = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        row = np.array([*across, -yaw_rate, -along @ (velocity - self.velocity)])
        if np.isfinite(row).all():
            self._fit.step(row[None], across[None] @ velocity)


class AirspeedCheck:
    """Compares the airspeed sensor with the wind triangle, second by second.

    The limits let through the gusts of moderate turbulence, and notice a sensor that reads 20 % wrong within
    five seconds (closed-loop flights).

    Examples
    --------
    >>> check = AirspeedCheck()
    >>> all(check.step(18.0 + k % 2, 18.5, settled=True) for k in range(120))
    True
    >>> [check.step(23.0 + k % 2, 18.5, settled=True) for k in range(6)][-1]
    False
    """

    def __init__(self) -> None:
        self._early: list[float] = []
        self._alive_s = 0
        self._offset: float | None = None
        self._recent: deque[float] = deque(maxlen=_DOUBTED[-1][0])
        self._doubted = False
        self._repeated, self._range = 0.0, (0.0, 0.0)

    def step(self, sensed: float, triangle: float, *, settled: bool) -> bool:
        """Take the mean airspeeds of a second of flight, m/s; return whether the sensor is trusted.

        The first minute in which the wind triangle is settled gives the usual ratio. A sensor that was
        never alive is not doubted, since nothing relies on it; one that repeats one number measures nothing.
        """
        if triangle > _MOVING_M_S and np.isfinite(sensed):
            least, most = self._range if sensed == self._repeated > _ALIVE_M_S else (triangle, triangle)
            self._repeated, self._range = sensed, (min(least, triangle), max(most, triangle))
            self._compare(sensed, triangle, settled=settled)
        return not self._doubted and self._range[1] - self._range[0] < _FROZEN_M_S

    def _compare(self, sensed: float, triangle: float, *, settled: bool) -> None:
        """Compare the airspeeds of a second."""
        if sensed <= _ALIVE_M_S:
            self._doubted |= self._alive_s >= _ALIVE_S
            return
        self._alive_s += 1
        ratio = float(np.log(sensed / triangle))
        if self._offset is not None:
            self._recent.append(ratio - self._offset)
            self._decide()
        if settled and len(self._early) < _EARLY_S[1]:
            self._early.append(ratio)
            if len(self._early) >= _EARLY_S[0]:
                self._offset = float(np.median(self._early))

    def _decide(self) -> None:
        changes = np.array(self._recent)
        if any(len(changes) >= s and abs(changes[-s:].mean()) > limit for s, limit in _DOUBTED):
            self._doubted = True
        elif len(changes) == self._recent.maxlen and abs(changes.mean()) < _TRUSTED:
            self._doubted = False


class Speed:
    """Follows the airspeed of one vehicle, from whole seconds of signals."""

    def __init__(self) -> None:
        self._wind = WindTriangle()
        self._check = AirspeedCheck()
        self._has_sensor = True

    def feed(self, signals: Mapping[str, Array]) -> tuple[Array, Flags, Flags, Array]:
        """Return the airspeed, m/s, whether it can be relied on, is settled, and its source, each (n,).

        It comes from the sensor (0), from the wind triangle (1), which settles in turns, or is the speed over
        ground (2).

        An autopilot without a sensor sends its own estimate in place of it, which is not used.

        ``signals`` are whole seconds, shape (k, RATE_HZ, columns).
        """
        triangle, settled = self._triangle(signals)
        sensed, ground, reported = (
            signals[name][:, :, 0] for name in ("airspeed", "groundspeed", "airspeed sensor")
        )
        sensed = np.where(self._sensor(reported[:, 0])[:, None], sensed, np.nan)
        trusted = [
            self._check.step(_mean(one), _mean(other), settled=is_settled)
            for one, other, is_settled in zip(sensed, triangle, settled, strict=True)
        ]
        source = np.where(sensed > _ALIVE_M_S, 0, np.where(np.isfinite(triangle), 1, 2))
        speed = np.choose(source, [sensed, triangle, ground])
        return (
            speed.ravel(),
            np.repeat(np.array(trusted, dtype=bool), RATE_HZ),
            ((source != 1) | np.array(settled)[:, None]).ravel(),
            source.ravel().astype(np.float64),
        )

    def _sensor(self, reported: Array) -> Flags:
        """Return in which seconds there is a sensor; the last report counts."""
        rows = np.maximum.accumulate(np.where(np.isfinite(reported), np.arange(1, reported.size + 1), 0))
        has: Flags = np.append(float(self._has_sensor), reported)[rows] > 0
        self._has_sensor = bool(has[-1])
        return has

    def _triangle(self, signals: Mapping[str, Array]) -> tuple[Array, list[bool]]:
        """Return the airspeed without the sensor, shape (k, RATE_HZ), and whether it is settled, of k."""
        winds, settled = [], []
        for velocity, attitude in zip(signals["velocity"][:, 0], signals["attitude"][:, 0], strict=True):
            self._wind.step(velocity[:2], float(attitude[2]))
            winds.append(self._wind.wind)
            settled.append(self._wind.is_settled)
        relative = signals["velocity"][:, :, :2] - np.array(winds)[:, None, :]
        # The wind is level, the flight need not be: in a climb or dive the air comes from ahead of the path.
        down = np.nan_to_num(signals["velocity"][:, :, 2])
        return np.sqrt((relative**2).sum(axis=2) + down**2), settled


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan


class Airspeeds:
    """Follows the airspeed of every vehicle, block by block, in constant memory.

    Examples
    --------
    >>> Airspeeds().at(1, np.array([0]))
    array([nan])
    """

    def __init__(self) -> None:
        self._known: dict[int, tuple[Integers, Array]] = {}

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the reports in these messages."""
        for vehicle, report in by_vehicle(tables, "sensed airspeed"):
            speed = report.values[:, 0]
            known = np.isfinite(speed) & (speed >= 0.0)
            if known.any():
                before_us, before = self._known.get(vehicle, (report.table.time_us[:0], speed[:0]))
                # What came with the block before may be asked for until this one comes, however long it was.
                kept = int(np.searchsorted(before_us, before_us[-1:] - _KEPT_US).sum())
                time_us = np.concatenate([before_us[kept:], report.table.time_us[known]])
                speed = np.concatenate([before[kept:], speed[known]])
                self._known[vehicle] = np.maximum.accumulate(time_us), speed

    def at(self, vehicle: int, utc_us: Integers) -> Array:
        """Return the airspeed at increasing times, m/s, shape (n,); NaN where it is unknown."""
        if vehicle not in self._known or not utc_us.size:
            return np.full(utc_us.size, np.nan)
        time_us, speed = self._known[vehicle]
        row = np.searchsorted(time_us, utc_us, side="right") - 1
        # Before the oldest that is kept, row is -1: that would be the newest.
        fresh = (row >= 0) & (utc_us - time_us[row] <= _STALE_US)
        return np.where(fresh, speed[row], np.nan)
