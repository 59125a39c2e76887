"""The flight mode of a vehicle, named as the autopilot's own ground station names it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from types import SimpleNamespace
from typing import Final

import numpy as np

from mavhums.log import Table
from mavhums.vehicle.texts import texts

__all__ = ["MODE_MESSAGES", "Modes", "kind_of"]

MODE_MESSAGES: Final = frozenset({"HEARTBEAT", "MODE", "MSG", "vehicle_status"})
"""Messages that tell: MAVLink's, DataFlash's, whose first texts name the kind of vehicle, and PX4's topic."""

_NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID: a camera, a gimbal, a ground station
_HEARTBEAT: Final = ("autopilot", "type", "base_mode", "custom_mode")
_KIND: Final = re.compile(
    r"(ArduPlane|ArduCopter|ArduRover|ArduSub|Rover|Blimp|AntennaTracker|APM:(?:Plane|Copter|Rover|Sub)) V?\d"
)
_HELD: Final = 100
_MAV_TYPES: Final = {
    "ArduPlane": 1,
    "ArduCopter": 2,
    "AntennaTracker": 5,
    "Blimp": 7,
    "ArduRover": 10,
    "Rover": 10,
    "ArduSub": 12,
    "APM:Plane": 1,  # before 2017
    "APM:Copter": 2,
    "APM:Rover": 10,
    "APM:Sub": 12,
}


_NAV_STATES: Final = {
    0: "MANUAL",
    1: "ALTCTL",
    2: "POSCTL",
    3: "MISSION",
    4: "LOITER",
    5: "RTL",
    6: "POSITION_SLOW",
    10: "ACRO",
    12: "DESCEND",
    13: "TERMINATION",
    14: "OFFBOARD",
    15: "STABILIZED",
    17: "TAKEOFF",
    18: "LAND",
    19: "FOLLOWME",
    20: "PRECISION_LAND",
    21: "ORBIT",
    22: "VTOL_TAKEOFF",
}
"""By PX4's vehicle_status.nav_state, whose numbers of modes that are no more were given to others."""


class Modes:
    """Follows the mode of every vehicle, block by block.

    Modes from an on-board log are kept back until the text that names the kind of vehicle.
    """

    def __init__(self) -> None:
        self._kinds: dict[int, int] = {}
        self._latest: dict[int, str] = {}
        self._waiting: list[tuple[int, int, int]] = []

    def feed(self, tables: Mapping[str, Table]) -> Iterator[tuple[int, int, str]]:
        """Yield (vehicle, microseconds of UTC, name) of each change."""
        for vehicle, time_us, mode in (
            *self._sent(tables.get("HEARTBEAT")),
            *self._logged(tables),
            *_navigated(tables.get("vehicle_status")),
        ):
            if mode != self._latest.get(vehicle):
                self._latest[vehicle] = mode
                yield vehicle, time_us, mode

    def _sent(self, table: Table | None) -> Iterator[tuple[int, int, str]]:
        if table is None:
            return
        own = table["autopilot"] != _NO_AUTOPILOT
        for vehicle in np.unique(table.system[own]).tolist():
            rows = np.flatnonzero((table.system == vehicle) & own)
            values = np.stack([table[field][rows].astype(np.int64) for field in _HEARTBEAT], axis=1)
            changed = np.append(True, (np.diff(values, axis=0) != 0).any(axis=1))
            for row, value in zip(rows[changed], values[changed], strict=True):
                yield vehicle, int(table.time_us[row]), _name_sent(*value.tolist())

    def _logged(self, tables: Mapping[str, Table]) -> Iterator[tuple[int, int, str]]:
        for said in texts({name: tables[name] for name in ("MSG",) if name in tables}):
            kind = kind_of(said.text)
            if kind is not None:
                self._kinds.setdefault(said.vehicle, kind)
        table = tables.get("MODE")
        if table is not None and "ModeNum" in (table.fields.dtype.names or ()):
            numbers = table["ModeNum"].tolist()
            self._waiting += zip(table.system.tolist(), table.time_us.tolist(), numbers, strict=True)
        waiting, self._waiting = self._waiting[-_HELD:], []
        for vehicle, time_us, number in waiting:
            if vehicle in self._kinds:
                yield vehicle, time_us, _name_logged(self._kinds[vehicle], number)
            else:
                self._waiting.append((vehicle, time_us, number))


def _navigated(table: Table | None) -> Iterator[tuple[int, int, str]]:
    if table is not None and table.holds({"nav_state": 1}):
        states = table["nav_state"].astype(np.int64)
        changed = np.append(True, np.diff(states) != 0)
        rows = zip(
            table.system[changed].tolist(),
            table.time_us[changed].tolist(),
            states[changed].tolist(),
            strict=True,
        )
        for vehicle, time_us, state in rows:
            yield vehicle, time_us, _NAV_STATES.get(state, f"Mode({state})")


def kind_of(text: str) -> int | None:
    """Return the MAV_TYPE of the vehicle whose firmware a text names; None for any other text.

    Examples
    --------
    >>> kind_of("ArduPlane V4.7.0-dev (2598e9d4)"), kind_of("APM:Copter V3.2"), kind_of("Throttle armed")
    (1, 2, None)
    """
    match = _KIND.match(text)
    return _MAV_TYPES[match[1]] if match else None


@cache
def _name_sent(autopilot: int, kind: int, base_mode: int, custom_mode: int) -> str:
    from pymavlink.mavutil import mode_string_v10

    heartbeat = SimpleNamespace(
        get_type=lambda: "HEARTBEAT",
        autopilot=autopilot,
        type=kind,
        base_mode=base_mode,
        custom_mode=custom_mode,
    )
    return str(mode_string_v10(heartbeat))


@cache
def _name_logged(kind: int, number: int) -> str:
    from pymavlink.mavutil import mode_mapping_bynumber

    names = mode_mapping_bynumber(kind)
    return str((names or {}).get(number, f"Mode({number})"))
