"""What a vehicle tells of itself: its attitude, its position, and the mode it flies in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.events import Attitude, FlightMode, Position

__all__ = ["STATE_MESSAGES", "VehicleStates"]

STATE_MESSAGES: Final = frozenset({"ATTITUDE", "GLOBAL_POSITION_INT", "HEARTBEAT"})

_NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID: a camera, a gimbal, a ground station
_NO_FIX_DEG: Final = 0.01  # before the first fix autopilots send positions about 0° N 0° E
_MODE: Final = ("autopilot", "type", "base_mode", "custom_mode")


class VehicleStates:
    """Follows the state of every vehicle, block after block.

    Examples
    --------
    >>> list(VehicleStates().feed({}, start_us=0))
    []
    """

    def __init__(self) -> None:
        self._clocks = Clocks()
        self._latest_us: dict[tuple[str, int], int] = {}
        self._components: dict[tuple[str, int], int] = {}
        self._modes: dict[int, str] = {}

    def feed(
        self, tables: Mapping[str, Table], *, start_us: int
    ) -> Iterator[Attitude | Position | FlightMode]:
        """Yield what these messages tell; flight times count from ``start_us``, microseconds of UTC."""
        for vehicle, table, time_us in self._each(tables.get("ATTITUDE")):
            angles = np.stack([table["roll"], table["pitch"], table["yaw"]], axis=1).astype(np.float64)
            good = np.isfinite(angles).all(axis=1)
            if good.any():
                yield Attitude(vehicle, (time_us[good] - start_us) / 1e6, angles[good])
        for vehicle, table, time_us in self._each(tables.get("GLOBAL_POSITION_INT")):
            degrees = np.stack([table["lat"], table["lon"]], axis=1) / 1e7
            fixed = (np.abs(degrees) > _NO_FIX_DEG).any(axis=1)
            good = fixed & (np.abs(degrees) <= (90, 180)).all(axis=1)
            if good.any():
                metres = table["alt"][good] / 1e3
                yield Position(vehicle, (time_us[good] - start_us) / 1e6, degrees[good], metres)
        self._clocks.jumps()  # are told by those who map the actuators
        yield from self._flight_modes(tables.get("HEARTBEAT"), start_us)

    def _each(self, table: Table | None) -> Iterator[tuple[int, Table, NDArray[np.int64]]]:
        """Yield each vehicle's messages, of the first component that sent one, increasing in time."""
        if table is None:
            return
        time_us = self._clocks.utc_us(table, 1000, "time_boot_ms")
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

    def _flight_modes(self, table: Table | None, start_us: int) -> Iterator[FlightMode]:
        if table is None:
            return
        for vehicle in np.unique(table.system[table["autopilot"] != _NO_AUTOPILOT]).tolist():
            rows = np.flatnonzero((table.system == vehicle) & (table["autopilot"] != _NO_AUTOPILOT))
            values = np.stack([table[field][rows].astype(np.int64) for field in _MODE], axis=1)
            changed = np.append(True, (np.diff(values, axis=0) != 0).any(axis=1))
            for row, value in zip(rows[changed], values[changed], strict=True):
                mode = _mode(dict(zip(_MODE, value.tolist(), strict=True)))
                if mode != self._modes.get(vehicle):
                    self._modes[vehicle] = mode
                    yield FlightMode(vehicle, (int(table.time_us[row]) - start_us) / 1e6, mode)


def _mode(heartbeat: dict[str, int]) -> str:
    """Return the name of a flight mode, as the autopilot's own ground station calls it."""
    from pymavlink.mavutil import mode_string_v10

    return str(mode_string_v10(SimpleNamespace(get_type=lambda: "HEARTBEAT", **heartbeat)))
