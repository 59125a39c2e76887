"""What a vehicle says and does, as events: its texts, its attitude, its position and its flight mode.

Times of events are flight times: seconds since the log's start.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.log import Table
from mavhums.vehicle.formats import by_vehicle, messages_of, reports
from mavhums.vehicle.formats.base import FormatModule

TEXT_MESSAGES: Final = messages_of("text")
"""Messages that carry texts."""

STATE_MESSAGES: Final = messages_of("attitude", "position", "mode", "text")
"""What :class:`VehicleStates` reads."""

MODE_MESSAGES: Final = messages_of("mode")
"""Messages that carry the flight mode."""

_NO_FIX_DEG: Final = 0.01  # before the first fix autopilots send positions about 0° N 0° E
_WAITING: Final = 100  # modes that wait for the text that names the kind of vehicle
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
_KIND: Final = re.compile(rf"({'|'.join(_MAV_TYPES)}) V?\d")


class Text(NamedTuple):
    """One text: its position in the log, its time in microseconds of UTC, and its sender."""

    frame: int
    time_us: int
    vehicle: int
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """The attitude of a vehicle: ``time_s`` of shape (n,), increasing; angles of shape (n, 3).

    The angles are roll (right wing down), pitch (nose up) and yaw (clockwise from north).
    """

    vehicle: int
    time_s: Array
    roll_pitch_yaw_rad: Array


@dataclass(frozen=True, slots=True, eq=False)
class Position:
    """The position of a vehicle: ``time_s`` of shape (n,), increasing, with coordinates and altitude.

    ``latitude_longitude_deg`` has shape (n, 2); ``altitude_m``, above mean sea level, has shape (n,).
    """

    vehicle: int
    time_s: Array
    latitude_longitude_deg: Array
    altitude_m: Array


@dataclass(frozen=True, slots=True)
class FlightMode:
    """A vehicle entered a flight mode, named as its autopilot's ground station names it."""

    vehicle: int
    time_s: float
    mode: str


def texts(tables: Mapping[str, Table]) -> Iterator[Text]:
    """Yield the texts that vehicles send, each kind of message in the order of the log."""
    for report in reports(tables, "text"):
        table = report.table
        rows = zip(
            table.frame.tolist(), table.time_us.tolist(), table.system.tolist(), report.texts, strict=True
        )
        yield from (Text(*row) for row in rows)


def kind_named(text: str) -> int | None:
    """Return the MAV_TYPE of the vehicle whose firmware a text names; None for any other text.

    Examples
    --------
    >>> kind_named("ArduPlane V4.7.0-dev (2598e9d4)"), kind_named("APM:Copter V3.2"), kind_named("Armed")
    (1, 2, None)
    """
    match = _KIND.match(text)
    return _MAV_TYPES[match[1]] if match else None


def _changes(tables: Mapping[str, Table]) -> Iterator[tuple[int, int, FormatModule, tuple[int, ...]]]:
    """Yield vehicle, microseconds of UTC, format and values of the first mode and of each other one."""
    for vehicle, report in by_vehicle(tables, "mode"):
        values, time_us = report.values, report.table.time_us
        changed = np.append(True, (np.diff(values, axis=0) != 0).any(axis=1))
        for row in np.flatnonzero(changed).tolist():
            yield vehicle, int(time_us[row]), report.format, tuple(values[row].tolist())


class VehicleStates:
    """Follows the state of every vehicle, block by block.

    A mode whose name depends on the kind of vehicle waits for the text that names the kind.

    Parameters
    ----------
    modes_only
        Whether to leave attitudes and positions out.

    Examples
    --------
    >>> list(VehicleStates().feed({}, start_us=0))
    []
    """

    def __init__(self, *, modes_only: bool = False) -> None:
        self._modes_only = modes_only
        self._latest_us: dict[tuple[str, int], int] = {}
        self._components: dict[tuple[str, int], int] = {}
        self._kinds: dict[int, int] = {}
        self._modes: dict[int, str] = {}
        self._waiting: list[tuple[int, int, FormatModule, tuple[int, ...]]] = []

    def feed(
        self, tables: Mapping[str, Table], *, start_us: int
    ) -> Iterator[Attitude | Position | FlightMode]:
        """Yield the states in these messages; flight times count from ``start_us``, microseconds of UTC."""
        for vehicle, time_us, angles in () if self._modes_only else self._each(tables, "attitude"):
            good = np.isfinite(angles).all(axis=1)
            if good.any():
                yield Attitude(vehicle, (time_us - start_us)[good] / 1e6, angles[good])
        for vehicle, time_us, place in () if self._modes_only else self._each(tables, "position"):
            degrees = place[:, :2]
            good = (np.abs(degrees) > _NO_FIX_DEG).any(axis=1) & (np.abs(degrees) <= (90, 180)).all(axis=1)
            if good.any():
                yield Position(vehicle, (time_us - start_us)[good] / 1e6, degrees[good], place[good, 2])
        for said in texts(tables):
            kind = kind_named(said.text)
            if kind is not None:
                self._kinds.setdefault(said.vehicle, kind)
        waiting, self._waiting = self._waiting[-_WAITING:], []
        for change in (*waiting, *_changes(tables)):
            vehicle, since_us, form, (autopilot, kind, base_mode, number) = change
            known = self._kinds.get(vehicle, kind) if kind < 0 else kind
            mode = form.mode_name(autopilot, known, base_mode, number)
            if mode is None:
                self._waiting.append(change)
            elif mode != self._modes.get(vehicle):
                self._modes[vehicle] = mode
                yield FlightMode(vehicle, (since_us - start_us) / 1e6, mode)

    def _each(self, tables: Mapping[str, Table], fact: str) -> Iterator[tuple[int, Integers, Array]]:
        """Yield each vehicle's times and values, from the first component that sent any, increasing in time.

        A viewer draws a line through them: two components, or a time that runs back, would make it jump.
        """
        for vehicle, report in by_vehicle(tables, fact):
            key = (report.source.message, vehicle)
            component = self._components.setdefault(key, int(report.table.component[0]))
            own = report.select(report.table.component == component)
            time_us = own.table.time_us
            before = np.maximum.accumulate(np.append(self._latest_us.get(key, -(1 << 62)), time_us))
            self._latest_us[key] = int(before[-1])
            later = own.select(time_us > before[:-1])
            if len(later.table):
                yield vehicle, later.table.time_us, later.values
