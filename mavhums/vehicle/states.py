"""The state that a vehicle reports: its attitude, its position and its flight mode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.events import Attitude, FlightMode, Position
from mavhums.vehicle.modes import MODE_MESSAGES, Modes

__all__ = ["STATE_MESSAGES", "VehicleStates"]

STATE_MESSAGES: Final = (
    frozenset(
        {"ATTITUDE", "ATT", "vehicle_attitude", "GLOBAL_POSITION_INT", "POS", "vehicle_global_position"}
    )
    | MODE_MESSAGES
)

_NO_FIX_DEG: Final = 0.01  # before the first fix autopilots send positions about 0° N 0° E

Array = NDArray[np.float64]


def _columns(table: Table, *fields: str) -> Array:
    return np.stack([table[field] for field in fields], axis=1).astype(np.float64)


class VehicleStates:
    """Follows the state of every vehicle, block by block.

    Examples
    --------
    >>> list(VehicleStates().feed({}, start_us=0))
    []
    """

    def __init__(self) -> None:
        self._latest_us: dict[tuple[str, int], int] = {}
        self._components: dict[tuple[str, int], int] = {}
        self._modes = Modes()

    def feed(
        self, tables: Mapping[str, Table], *, start_us: int
    ) -> Iterator[Attitude | Position | FlightMode]:
        """Yield the states in these messages; flight times count from ``start_us``, microseconds of UTC."""
        for vehicle, table, time_us in self._each(tables.get("ATTITUDE")):
            yield from _attitude(vehicle, _columns(table, "roll", "pitch", "yaw"), time_us - start_us)
        for vehicle, table, time_us in self._each(tables.get("ATT")):
            angles = np.radians(_columns(table, "Roll", "Pitch", "Yaw"))
            yield from _attitude(vehicle, angles, time_us - start_us)
        for vehicle, table, time_us in self._each(tables.get("GLOBAL_POSITION_INT")):
            degrees = _columns(table, "lat", "lon") / 1e7
            yield from _position(vehicle, degrees, table["alt"] / 1e3, time_us - start_us)
        for vehicle, table, time_us in self._each(tables.get("POS")):
            degrees, metres = _columns(table, "Lat", "Lng"), table["Alt"].astype(np.float64)
            yield from _position(vehicle, degrees, metres, time_us - start_us)
        attitudes, positions = tables.get("vehicle_attitude"), tables.get("vehicle_global_position")
        if attitudes is not None and attitudes.holds({"q": 4}):
            for vehicle, table, time_us in self._each(attitudes):
                angles = _angles_of(table["q"].astype(np.float64))
                yield from _attitude(vehicle, angles, time_us - start_us)
        if positions is not None and positions.holds({"lat": 1, "lon": 1, "alt": 1}):
            for vehicle, table, time_us in self._each(positions):
                metres = table["alt"].astype(np.float64)
                yield from _position(vehicle, _columns(table, "lat", "lon"), metres, time_us - start_us)
        for vehicle, since_us, mode in self._modes.feed(tables):
            yield FlightMode(vehicle, (since_us - start_us) / 1e6, mode)

    def _each(self, table: Table | None) -> Iterator[tuple[int, Table, NDArray[np.int64]]]:
        """Yield each vehicle's messages, from the first component that sent one, increasing in time."""
        if table is None:
            return
        time_us = table.time_us
        for vehicle in np.unique(table.system).tolist():
            key = (table.name, vehicle)
            rows = np.flatnonzero(table.system == vehicle)
            component = self._components.setdefault(key, int(table.component[rows[0]]))
            rows = rows[table.component[rows] == component]
            before = np.maximum.accumulate(np.append(self._latest_us.get(key, -(1 << 62)), time_us[rows]))
            self._latest_us[key] = int(before[-1])
            rows = rows[time_us[rows] > before[:-1]]
            if rows.size:
                yield vehicle, table.select(rows), time_us[rows]


def _angles_of(q: Array) -> Array:
    """Return roll, pitch and yaw, rad, shape (n, 3), of quaternions w, x, y, z, body to north-east-down."""
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=1)


def _attitude(vehicle: int, angles: Array, time_us: NDArray[np.int64]) -> Iterator[Attitude]:
    good = np.isfinite(angles).all(axis=1)
    if good.any():
        yield Attitude(vehicle, time_us[good] / 1e6, angles[good])


def _position(vehicle: int, degrees: Array, metres: Array, time_us: NDArray[np.int64]) -> Iterator[Position]:
    fixed = (np.abs(degrees) > _NO_FIX_DEG).any(axis=1)
    good = fixed & (np.abs(degrees) <= (90, 180)).all(axis=1)
    if good.any():
        yield Position(vehicle, time_us[good] / 1e6, degrees[good], metres[good])
