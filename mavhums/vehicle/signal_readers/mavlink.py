"""Reads signals from MAVLink messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.log.base.tables import LOOSE_TIME
from mavhums.vehicle.clocks import stamped
from mavhums.vehicle.signals import OUTPUTS, Signal, placed

__all__ = ["MESSAGES", "MavlinkSignals"]

_G: Final = 9.80665
_NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID
_ARMED: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_PULSES_US: Final = (800.0, 2200.0)
_NO_ATTITUDE: Final = 1 << 7  # ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE

_PORTS: Final = {"outputs": 0, "outputs_2": 1}

Array = NDArray[np.float64]


def _columns(table: Table, *fields: str, scale: float = 1.0) -> Array:
    return np.stack([table[field].astype(np.float64) for field in fields], axis=1) * scale


def _navigated(table: Table) -> Array:
    """Return the demanded attitude where its time is known, else NaN.

    A demand that arrives seconds before or after the attitude that answers it looks as if no surface obeyed.
    """
    loose = (table.flags & LOOSE_TIME) > 0
    return np.where(loose[:, None], np.nan, np.radians(_columns(table, "nav_roll", "nav_pitch")))


def _outputs(table: Table) -> Array:
    pulses = _columns(table, *(f"servo{n}_raw" for n in range(1, OUTPUTS + 1)))
    return np.where((pulses < _PULSES_US[0]) | (pulses > _PULSES_US[1]), np.nan, pulses)


def _second_outputs(table: Table) -> Array:
    return placed(_outputs(table), OUTPUTS)


def _milli_rates(table: Table) -> Array:
    return _columns(table, "xgyro", "ygyro", "zgyro", scale=1e-3)


def _milli_force(table: Table) -> Array:
    return _columns(table, "xacc", "yacc", "zacc", scale=_G / 1e3)


def _of_quaternion(table: Table) -> Array:
    w, x, y, z = np.asarray(table["q"], dtype=np.float64).T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    asked = (table["type_mask"] & _NO_ATTITUDE) == 0
    return np.where(asked[:, None], np.stack([roll, pitch], axis=1), np.nan)


class _Source(NamedTuple):
    """A message, the signal that it gives, and its values; earlier entries are preferred."""

    message: str
    signal: str
    values: Callable[[Table], Array]


_SOURCES: Final = (
    _Source("SERVO_OUTPUT_RAW", "outputs", _outputs),
    _Source("SERVO_OUTPUT_RAW", "outputs_2", _second_outputs),
    _Source("HIGHRES_IMU", "rates", lambda t: _columns(t, "xgyro", "ygyro", "zgyro")),
    _Source("RAW_IMU", "rates", _milli_rates),
    _Source("SCALED_IMU", "rates", _milli_rates),
    _Source("SCALED_IMU2", "rates", _milli_rates),
    _Source("HIGHRES_IMU", "force", lambda t: _columns(t, "xacc", "yacc", "zacc")),
    _Source("RAW_IMU", "force", _milli_force),
    _Source("SCALED_IMU", "force", _milli_force),
    _Source("SCALED_IMU2", "force", _milli_force),
    _Source("ATTITUDE", "attitude", lambda t: _columns(t, "roll", "pitch", "yaw")),
    _Source("ATTITUDE", "slow_rates", lambda t: _columns(t, "rollspeed", "pitchspeed", "yawspeed")),
    _Source("ATTITUDE_TARGET", "demand", _of_quaternion),
    _Source("NAV_CONTROLLER_OUTPUT", "demand", _navigated),
    _Source("VFR_HUD", "airspeed", lambda t: _columns(t, "airspeed")),
    _Source("VFR_HUD", "groundspeed", lambda t: _columns(t, "groundspeed")),
    _Source("GLOBAL_POSITION_INT", "velocity", lambda t: _columns(t, "vx", "vy", scale=0.01)),
    _Source("GLOBAL_POSITION_INT", "altitude", lambda t: _columns(t, "relative_alt", scale=1e-3)),
    _Source("VFR_HUD", "altitude", lambda t: _columns(t, "alt")),
    _Source("EXTENDED_SYS_STATE", "vtol", lambda t: _columns(t, "vtol_state")),
    _Source("EXTENDED_SYS_STATE", "landed", lambda t: _columns(t, "landed_state")),
)

MESSAGES: Final = frozenset({source.message for source in _SOURCES} | {"HEARTBEAT", "PARAM_VALUE"})


class MavlinkSignals:
    """Reads signals from the tables of MAVLink messages, block by block.

    If several messages of a vehicle give the same signal, the first received is used; if several components
    send that message, the first sender is used.
    """

    def __init__(self) -> None:
        self._taken: dict[tuple[int, str], tuple[str, int]] = {}

    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the signals of these messages."""
        yield from self._states(tables.get("HEARTBEAT"))
        self._choose(tables)
        for message, signal, values in _SOURCES:
            table = tables.get(message)
            if table is None:
                continue
            for vehicle in np.unique(table.system).tolist():
                taken = self._taken.get((vehicle, signal))
                if taken is None or taken[0] != message:
                    continue
                own = (table.system == vehicle) & (table.component == taken[1])
                if signal in _PORTS:
                    own &= table["port"] == _PORTS[signal]
                rows = np.flatnonzero(own)
                if rows.size:
                    part = table.select(rows)
                    told = (part.frame, part.time_us, values(part))
                    yield Signal(vehicle, signal, message, *told, stamped=stamped(part))

    def _choose(self, tables: Mapping[str, Table]) -> None:
        """Choose for each signal the message that came first, whatever block it came in."""
        firsts: dict[tuple[int, str], tuple[int, str, int]] = {}
        for message, signal, _ in _SOURCES:
            table = tables.get(message)
            if table is None:
                continue
            systems, rows = np.unique(table.system, return_index=True)
            for vehicle, row in zip(systems.tolist(), rows.tolist(), strict=True):
                if (vehicle, signal) not in self._taken:
                    found = (int(table.frame[row]), message, int(table.component[row]))
                    firsts[vehicle, signal] = min(found, firsts.get((vehicle, signal), found))
        for key, (_, message, component) in firsts.items():
            self._taken[key] = message, component

    def _states(self, table: Table | None) -> Iterator[Signal]:
        if table is None:
            return
        own = table.select(table["autopilot"] != _NO_AUTOPILOT)
        for vehicle in np.unique(own.system).tolist():
            part = own.select(own.system == vehicle)
            armed = (part["base_mode"] & _ARMED) > 0
            fields = (part["type"], part["autopilot"], armed, part["custom_mode"])
            values = np.stack([field.astype(np.float64) for field in fields], axis=1)
            yield Signal(vehicle, "state", "HEARTBEAT", part.frame, part.time_us, values, stamped=False)
