"""Reads signals from the records of ArduPilot's on-board log.

Of several sensors, the first is used (``I`` = 0). Every STAT record gives a state: whether the vehicle is
armed, with the mode of the last MODE record. The text of the firmware gives the kind of vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.modes import kind_of
from mavhums.vehicle.signals import ALL_OUTPUTS, OUTPUTS, Signal
from mavhums.vehicle.texts import texts

__all__ = ["MESSAGES", "DataFlashSignals"]

_ARDUPILOT: Final = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
_ON_GROUND, _IN_AIR = 1.0, 2.0  # MAV_LANDED_STATE
_FIX: Final = 3
_PULSES_US: Final = (800.0, 2200.0)

Array = NDArray[np.float64]


def _columns(table: Table, *fields: str) -> Array:
    return np.stack([table[field].astype(np.float64) for field in fields], axis=1)


def _outputs(table: Table, count: int = OUTPUTS) -> Array:
    pulses = np.full((len(table), count), np.nan)
    for k in range(count):
        if f"C{k + 1}" in (table.fields.dtype.names or ()):
            pulses[:, k] = table[f"C{k + 1}"]
    return np.where((pulses < _PULSES_US[0]) | (pulses > _PULSES_US[1]), np.nan, pulses)


def _all_outputs(table: Table) -> Array:
    return _outputs(table, ALL_OUTPUTS)


def _velocity(table: Table) -> Array:
    speed, course = table["Spd"].astype(np.float64), np.radians(table["GCrs"].astype(np.float64))
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course)], axis=1)
    return np.where((table["Status"] >= _FIX)[:, None], velocity, np.nan)


class _Source(NamedTuple):
    """A message, the signal that it gives, the columns that it needs, and its values."""

    message: str
    signal: str
    fields: tuple[str, ...]
    values: Callable[[Table], Array]


def _plain(message: str, signal: str, *fields: str) -> _Source:
    return _Source(message, signal, fields, lambda table: _columns(table, *fields))


def _degrees(message: str, signal: str, *fields: str) -> _Source:
    return _Source(message, signal, fields, lambda table: np.radians(_columns(table, *fields)))


_SOURCES: Final = (
    _Source("RCOU", "outputs", ("C1",), _outputs),
    _Source("RCO2", "outputs_2", (), _all_outputs),
    _Source("RCO3", "outputs_3", (), _all_outputs),
    _plain("IMU", "rates", "GyrX", "GyrY", "GyrZ"),
    _plain("IMU", "force", "AccX", "AccY", "AccZ"),
    _degrees("ATT", "attitude", "Roll", "Pitch", "Yaw"),
    _degrees("ATT", "demand", "DesRoll", "DesPitch"),
    _plain("ARSP", "airspeed", "Airspeed"),
    _Source("GPS", "velocity", ("Status", "Spd", "GCrs"), _velocity),
    _plain("GPS", "groundspeed", "Spd"),
    _plain("POS", "altitude", "RelHomeAlt"),
)

MESSAGES: Final = frozenset({source.message for source in _SOURCES} | {"MODE", "MSG", "PARM", "STAT"})


class DataFlashSignals:
    """Reads signals from the tables of an on-board log, block by block."""

    def __init__(self) -> None:
        self._kinds: dict[int, tuple[int, float]] = {}
        self._modes: dict[int, float] = {}

    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the signals of these records."""
        yield from self._states(tables)
        for message, signal, fields, values in _SOURCES:
            table = tables.get(message)
            if table is None or not set(fields) <= set(table.fields.dtype.names or ()):
                continue
            if "I" in (table.fields.dtype.names or ()):
                table = table.select(table["I"] == 0)
            for vehicle in np.unique(table.system).tolist():
                part = table.select(table.system == vehicle)
                yield Signal(vehicle, signal, message, part.frame, part.time_us, values(part))

    def _states(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        for said in texts({name: tables[name] for name in ("MSG",) if name in tables}):
            kind = kind_of(said.text)
            if kind is not None:
                self._kinds.setdefault(said.vehicle, (said.frame, float(kind)))
        stat, mode = tables.get("STAT"), tables.get("MODE")
        if stat is not None and {"Armed", "isFlying"} <= set(stat.fields.dtype.names or ()):
            for vehicle in np.unique(stat.system).tolist():
                part = stat.select(stat.system == vehicle)
                yield from self._state(vehicle, part, mode)
        if mode is not None and "ModeNum" in (mode.fields.dtype.names or ()):
            for vehicle, number in zip(mode.system.tolist(), mode["ModeNum"].tolist(), strict=True):
                self._modes[vehicle] = float(number)

    def _state(self, vehicle: int, stat: Table, mode: Table | None) -> Iterator[Signal]:
        kinds = np.full(len(stat), np.nan)
        if vehicle in self._kinds:
            since, kind = self._kinds[vehicle]
            kinds[stat.frame > since] = kind
        numbers = np.array([self._modes.get(vehicle, np.nan)])
        frames = np.array([-1])
        if mode is not None and "ModeNum" in (mode.fields.dtype.names or ()):
            own = mode.select(mode.system == vehicle)
            frames = np.append(frames, own.frame)
            numbers = np.append(numbers, own["ModeNum"].astype(np.float64))
        modes = numbers[np.searchsorted(frames, stat.frame) - 1]
        autopilot = np.full(len(stat), float(_ARDUPILOT))
        values = np.stack([kinds, autopilot, (stat["Armed"] > 0).astype(np.float64), modes], axis=1)
        yield Signal(vehicle, "state", "STAT", stat.frame, stat.time_us, values)
        landed = np.where(stat["isFlying"] > 0, _IN_AIR, _ON_GROUND)[:, None]
        yield Signal(vehicle, "landed", "STAT", stat.frame, stat.time_us, landed)
