"""Reads signals from the topics of a PX4 ULog, whose times are all of one clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.signals import OUTPUTS, Signal, placed

__all__ = ["MESSAGES", "UlogSignals"]

_PULSES_US: Final = (800.0, 2200.0)
_PX4: Final = 12  # MAV_AUTOPILOT_PX4
_ARMED: Final = 2  # vehicle_status.ARMING_STATE_ARMED
_ON_GROUND, _IN_AIR = 1, 2  # MAV_LANDED_STATE

Array = NDArray[np.float64]


def _columns(table: Table, *fields: str) -> Array:
    return np.stack([table[field].astype(np.float64) for field in fields], axis=1)


def _outputs(table: Table) -> Array:
    pulses = table["output"].astype(np.float64)
    return np.where((pulses < _PULSES_US[0]) | (pulses > _PULSES_US[1]), np.nan, pulses)


def _second_outputs(table: Table) -> Array:
    return placed(_outputs(table), OUTPUTS)


def _angles(q: NDArray[np.float32]) -> Array:
    """Return roll, pitch and yaw, rad, of quaternions w, x, y, z from body to north-east-down."""
    w, x, y, z = q.astype(np.float64).T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=1)


def _state(table: Table) -> Array:
    """Return MAV_TYPE, MAV_AUTOPILOT, whether armed, and PX4's navigation state."""
    armed = table["arming_state"] == _ARMED
    columns = (table["system_type"], np.full(len(table), _PX4), armed, table["nav_state"])
    return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=1)


def _landed(table: Table) -> Array:
    return np.where(table["landed"] != 0, _ON_GROUND, _IN_AIR).astype(np.float64)[:, None]


class _Source(NamedTuple):
    """A topic, the signal that it gives, the fields that it needs with their widths, and its values."""

    topic: str
    signal: str
    widths: dict[str, int]
    values: Callable[[Table], Array]


def _plain(topic: str, signal: str, *fields: str) -> _Source:
    return _Source(topic, signal, dict.fromkeys(fields, 1), lambda t: _columns(t, *fields))


_INSTANCES: Final = {"outputs": 0, "outputs_2": 1}  # PX4's MAIN and AUX outputs

_SOURCES: Final = (
    _Source("actuator_outputs", "outputs", {"output": OUTPUTS}, _outputs),
    _Source("actuator_outputs", "outputs_2", {"output": OUTPUTS}, _second_outputs),
    _Source("sensor_combined", "rates", {"gyro_rad": 3}, lambda t: t["gyro_rad"].astype(np.float64)),
    _Source("vehicle_angular_velocity", "rates", {"xyz": 3}, lambda t: t["xyz"].astype(np.float64)),
    _Source(
        "sensor_combined",
        "force",
        {"accelerometer_m_s2": 3},
        lambda t: t["accelerometer_m_s2"].astype(np.float64),
    ),
    _Source("vehicle_attitude", "attitude", {"q": 4}, lambda t: _angles(t["q"])),
    _Source("vehicle_angular_velocity", "slow_rates", {"xyz": 3}, lambda t: t["xyz"].astype(np.float64)),
    _plain("vehicle_attitude", "slow_rates", "rollspeed", "pitchspeed", "yawspeed"),
    _Source("vehicle_attitude_setpoint", "demand", {"q_d": 4}, lambda t: _angles(t["q_d"])[:, :2]),
    _plain("vehicle_attitude_setpoint", "demand", "roll_body", "pitch_body"),
    _plain("airspeed", "airspeed", "indicated_airspeed_m_s"),
    _plain("airspeed_validated", "airspeed", "indicated_airspeed_m_s"),
    _plain("vehicle_local_position", "velocity", "vx", "vy"),
    _Source(
        "vehicle_local_position",
        "groundspeed",
        {"vx": 1, "vy": 1},
        lambda t: np.hypot(t["vx"], t["vy"]).astype(np.float64)[:, None],
    ),
    _Source("vehicle_local_position", "altitude", {"z": 1}, lambda t: -_columns(t, "z")),
    _Source("vehicle_status", "state", {"arming_state": 1, "system_type": 1, "nav_state": 1}, _state),
    _plain("vtol_vehicle_status", "vtol", "vehicle_vtol_state"),
    _Source("vehicle_land_detected", "landed", {"landed": 1}, _landed),
)

MESSAGES: Final = frozenset({source.topic for source in _SOURCES} | {"parameter"})


class UlogSignals:
    """Reads signals from topics, block by block.

    If several topics or instances give the same signal, the first received is used; for outputs, always
    instance 0. A topic with a different field layout gives no signal.
    """

    def __init__(self) -> None:
        self._taken: dict[tuple[int, str], tuple[int, int]] = {}

    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the signals of these tables."""
        found = [
            (place, source, tables[source.topic])
            for place, source in enumerate(_SOURCES)
            if source.topic in tables and _holds(tables[source.topic], source.widths)
        ]
        self._choose(found)
        for place, source, table in found:
            for vehicle in np.unique(table.system).tolist():
                taken, instance = self._taken[vehicle, source.signal]
                if taken != place:
                    continue
                rows = np.flatnonzero((table.system == vehicle) & (table.component == instance))
                if rows.size:
                    part = table.select(rows)
                    yield Signal(
                        vehicle, source.signal, source.topic, part.frame, part.time_us, source.values(part)
                    )

    def _choose(self, found: list[tuple[int, _Source, Table]]) -> None:
        """Choose for each signal the topic whose first record came first, whatever block it came in."""
        firsts: dict[tuple[int, str], tuple[int, int, int]] = {}
        for place, source, table in found:
            for vehicle in np.unique(table.system).tolist():
                key = (vehicle, source.signal)
                if key not in self._taken:
                    row = int(np.argmax(table.system == vehicle))
                    instance = _INSTANCES.get(source.signal, int(table.component[row]))
                    first = (int(table.frame[row]), place, instance)
                    firsts[key] = min(first, firsts.get(key, first))
        for key, (_, place, instance) in firsts.items():
            self._taken[key] = place, instance


def _holds(table: Table, widths: Mapping[str, int]) -> bool:
    """Return whether these numeric fields with these widths exist; each log defines its own fields."""
    wire = table.fields.dtype
    for name, width in widths.items():
        if name not in (wire.names or ()) or wire[name].base.kind not in "iuf":
            return False
        if (wire[name].shape or (1,)) != (width,):
            return False
    return True
