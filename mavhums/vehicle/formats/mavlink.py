"""Where MAVLink keeps each fact: telemetry logs and live links.

Times are those of the senders' clocks, see :mod:`mavhums.vehicle.clocks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.statistics import STANDARD_GRAVITY
from mavhums.log import Table
from mavhums.log.base.decoder import LOOSE_TIME
from mavhums.vehicle.facts import NO_AUTOPILOT, OUTPUTS, PX4, ServoIds
from mavhums.vehicle.formats.base import (
    ANY,
    RATES,
    TEXT,
    ServoPart,
    ServoSource,
    Source,
    Split,
    angles_of,
    bits_of,
    columns,
    instrumented,
    named,
    plain,
    pulses,
    records_of_parameters,
    supply_faults,
    whole,
    wide,
)
from mavhums.vehicle.formats.mode_names import ardupilot_mode, px4_mode

STAMPS: Final = ("time_boot_ms", "time_usec")
"""Fields with the time of the sender's clock; the first in a message counts."""

_NOT_OWN_TIME: Final = frozenset({"SYSTEM_TIME", "GPS_RAW_INT", "GPS2_RAW", "GPS_INPUT", "HIL_GPS"})
"""Messages whose stamp may be the satellites' time, or that of the last fix: they show no clock."""

CLOCKS: Final = frozenset({"RC_CHANNELS", "RC_CHANNELS_RAW"})
"""Stamped messages that nothing is read from: they come often, and on a bad link each stamp counts."""

_CUSTOM_MODE: Final = 1  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_ARMED: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_NO_ATTITUDE: Final = 1 << 7  # ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_ARDUPILOT_ID_BYTES: Final = 12  # of uid2's 18: the others are zero in ArduPilot

_SERVO_FIELDS: Final = tuple(f"servo{n}_raw" for n in range(1, OUTPUTS + 1))
_SERVOS: Final = {"port": 1, **dict.fromkeys(_SERVO_FIELDS, 1)}
_HEARTBEAT: Final = dict.fromkeys(("type", "autopilot", "base_mode", "custom_mode"), 1)
_VERSION: Final = {"uid2": 18, "uid": 1, "flight_sw_version": 1}


def stamp_of(table: Table) -> str | None:
    """Return the field of a message's stamp; None if it has none."""
    if table.name in _NOT_OWN_TIME:
        return None
    return next((stamp for stamp in STAMPS if table.holds({stamp: 1})), None)


def is_stamped(table: Table) -> bool:
    """Return whether messages of this type carry the time of their sender's clock."""
    return stamp_of(table) is not None


def mode_name(autopilot: int, kind: int, base_mode: int, number: int) -> str:
    """Return the name of a flight mode."""
    if autopilot == PX4:
        return px4_mode(number)
    return ardupilot_mode(kind, number) if base_mode & _CUSTOM_MODE else f"Mode(0x{base_mode:08x})"


def _outputs(table: Table) -> Array:
    return pulses(columns(table, *_SERVO_FIELDS))


def _port(number: int) -> Any:
    return lambda table: table["port"] == number


def _navigated(table: Table) -> Array:
    """Return the commanded attitude where its time is known, else NaN.

    A command that arrives seconds before or after the attitude that answers it looks as if no surface obeyed.
    """
    loose = (table.flags & LOOSE_TIME) > 0
    return np.where(loose[:, None], np.nan, np.radians(columns(table, "nav_roll", "nav_pitch")))


def _target(table: Table) -> Array:
    asked = (table["type_mask"] & _NO_ATTITUDE) == 0
    return np.where(asked[:, None], angles_of(table["q"])[:, :2], np.nan)


def _has_autopilot(table: Table) -> Flags:
    return np.asarray(table["autopilot"] != NO_AUTOPILOT)


def _state(table: Table) -> Array:
    armed = (table["base_mode"] & _ARMED) > 0
    fields = (table["type"], table["autopilot"], armed, table["custom_mode"])
    return np.stack([field.astype(np.float64) for field in fields], axis=1)


def _mode(table: Table) -> NDArray[Any]:
    fields = ("autopilot", "type", "base_mode", "custom_mode")
    return np.stack([table[field].astype(np.int64) for field in fields], axis=1)


def _boards(table: Table) -> NDArray[Any]:
    """Return the boards' ids: ``uid2`` with the length that the autopilot gives it, else ``uid``."""
    ids = []
    for uid2, uid in zip(table["uid2"], table["uid"].tolist(), strict=True):
        known = uid2 if uid2[_ARDUPILOT_ID_BYTES:].any() else uid2[:_ARDUPILOT_ID_BYTES]
        ids.append(known.tobytes().hex().upper() if uid2.any() else f"{uid:016X}")
    return np.array(ids, dtype="S")


def _boot(table: Table) -> NDArray[Any]:
    return table["time_unix_usec"].astype(np.int64) - table["time_boot_ms"].astype(np.int64) * 1000


def _position(table: Table) -> Array:
    return np.column_stack([columns(table, "lat", "lon") / 1e7, table["alt"] / 1e3])


def _parameters(table: Table) -> NDArray[Any]:
    bits = np.ascontiguousarray(table["param_value"]).view("<u4")
    return records_of_parameters(table["param_id"], bits, table["param_type"])


_BATCH: Final = 4  # ESCs in a message
_HEALTH: Final = ("onboard_control_sensors_enabled", "onboard_control_sensors_health")
_PRESENT: Final = "onboard_control_sensors_present"
_AUTOPILOT: Final = 1  # MAV_COMP_ID: a gimbal or a companion computer has sensors of its own
_AIRSPEED, _OUTPUTS, _PROPULSION = 1 << 4, 1 << 15, 1 << 26  # MAV_SYS_STATUS_SENSOR


def _unhealthy(table: Table) -> Integers:
    enabled, healthy = (whole(field)(table) for field in _HEALTH)
    return bits_of(*(enabled & ~healthy & part for part in (_OUTPUTS, _PROPULSION)))


_MILLI_IMUS: Final = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2")  # rates in mrad/s, forces in mg
_MILLI_RATES: Final = ("xgyro", "ygyro", "zgyro")
_MILLI_FORCE: Final = ("xacc", "yacc", "zacc")
_ESC_BATCHES: Final = {f"ESC_TELEMETRY_{k + 1}_TO_{k + 4}": k for k in range(0, 32, 4)}

NAME: Final = "tlog"
AUTOPILOT: Final = None
"""Which autopilot writes such logs: any."""

SOURCES: Final = (
    Source("state", "HEARTBEAT", _HEARTBEAT, _state, _has_autopilot, all_components=True),
    Source("outputs", "SERVO_OUTPUT_RAW", _SERVOS, _outputs, _port(0)),
    Source("outputs_2", "SERVO_OUTPUT_RAW", _SERVOS, lambda t: wide(_outputs(t), OUTPUTS), _port(1)),
    plain("rates", "HIGHRES_IMU", *_MILLI_RATES),
    *(plain("rates", name, *_MILLI_RATES, scale=1e-3) for name in _MILLI_IMUS),
    plain("rates", "ATTITUDE", "rollspeed", "pitchspeed", "yawspeed"),
    plain("force", "HIGHRES_IMU", *_MILLI_FORCE),
    *(plain("force", name, *_MILLI_FORCE, scale=STANDARD_GRAVITY / 1e3) for name in _MILLI_IMUS),
    plain("attitude", "ATTITUDE", "roll", "pitch", "yaw"),
    Source("demand", "ATTITUDE_TARGET", {"q": 4, "type_mask": 1}, _target),
    Source("demand", "NAV_CONTROLLER_OUTPUT", {"nav_roll": 1, "nav_pitch": 1}, _navigated),
    plain("airspeed", "VFR_HUD", "airspeed"),
    plain("groundspeed", "VFR_HUD", "groundspeed"),
    plain("velocity", "GLOBAL_POSITION_INT", "vx", "vy", "vz", scale=0.01),
    plain("altitude", "GLOBAL_POSITION_INT", "relative_alt", scale=1e-3),
    plain("altitude", "VFR_HUD", "alt"),
    plain("altitude", "LOCAL_POSITION_NED", "z", scale=-1.0),
    plain("altitude error", "NAV_CONTROLLER_OUTPUT", "alt_error"),
    Source(
        "airspeed sensor",
        "SYS_STATUS",
        {_PRESENT: 1},
        lambda t: (whole(_PRESENT, column=True)(t) & _AIRSPEED > 0) * 1.0,
        lambda t: (t[_PRESENT] > 0) & (t.component == _AUTOPILOT),
    ),
    plain("vtol", "EXTENDED_SYS_STATE", "vtol_state"),
    plain("landed", "EXTENDED_SYS_STATE", "landed_state"),
    Source("mode", "HEARTBEAT", _HEARTBEAT, _mode, _has_autopilot),
    Source("autopilot", "HEARTBEAT", _HEARTBEAT, lambda t: np.stack([t["type"], t["autopilot"]], axis=1)),
    Source("firmware", "AUTOPILOT_VERSION", _VERSION, lambda t: t["flight_sw_version"]),
    Source("board", "AUTOPILOT_VERSION", _VERSION, _boards, lambda t: t["uid2"].any(axis=1) | (t["uid"] > 0)),
    Source("boot", "SYSTEM_TIME", {"time_unix_usec": 1, "time_boot_ms": 1}, _boot),
    Source("uptime", "ATTITUDE", {"time_boot_ms": 1}, lambda t: t["time_boot_ms"].astype(np.int64) * 1000),
    Source("text", "STATUSTEXT", {"text": TEXT}, lambda t: t["text"]),
    Source("parameter", "PARAM_VALUE", {"param_id": TEXT, "param_value": 1, "param_type": 1}, _parameters),
    Source("position", "GLOBAL_POSITION_INT", {"lat": 1, "lon": 1, "alt": 1}, _position),
    plain("sensed airspeed", "VFR_HUD", "airspeed"),
    *(
        Source("named value", name, {"name": TEXT}, lambda t: t["name"])
        for name in ("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY")
    ),
    *(
        Source(fact, "ESC_INFO", {field: _BATCH, "index": 1}, whole(field), first=whole("index"))
        for fact, field in (("ESC errors", "error_count"), ("ESC faults", "failure_flags"))
    ),
    Source("supply faults", "POWER_STATUS", {"flags": 1}, lambda t: supply_faults(whole("flags")(t))),
    Source("autopilot faults", "SYS_STATUS", dict.fromkeys(_HEALTH, 1), _unhealthy),
    plain("servo rail", "POWER_STATUS", "Vservo", scale=1e-3),
    Source("script value", "NAMED_VALUE_FLOAT", {"name": TEXT, "value": 1}, lambda t: t["name"]),
)

# Servo telemetry

_STATUS_FIELDS: Final = {"V4": "voltage", "V5": "current", "V7": "rpm"}
_TELEMETRY_UNITS: Final = (0.01, 0.01, 1.0)  # 10 mV, 10 mA, 1 rev/min
_PER_STATUS: Final = 32


def _repeated(table: Table) -> Flags:
    """Return which batches repeat the time and values of the previous one, shape (n,).

    PX4 repeats ESCs 0–3 in the batch whose index is 4: taken as they are, four ESCs would be eight.
    """
    repeated = np.zeros(len(table), dtype=bool)
    if len(table) > 1:
        same = table["index"][1:] != table["index"][:-1]
        same &= table.system[1:] == table.system[:-1]
        for field in ("time_usec", *_STATUS_FIELDS.values()):
            equal = table[field][1:] == table[field][:-1]
            same &= equal.all(axis=1) if equal.ndim == 2 else equal
        repeated[1:] = same
    return repeated


def _esc_status(table: Table, servos: Sequence[ServoIds]) -> Split:
    fresh = ~_repeated(table)
    values = np.stack([table[field].astype(np.float64) for field in _STATUS_FIELDS.values()], axis=2)
    for ids in servos:
        if ids.esc is not None:
            k = ids.esc % _BATCH
            rows = fresh & (table["index"] == ids.esc - k)
            yield ids, ServoPart(f"ESC_STATUS[{ids.esc}]", _STATUS_FIELDS, rows, values[:, k])


def _esc_telemetry(table: Table, servos: Sequence[ServoIds]) -> Split:
    first = _ESC_BATCHES[table.name]
    ours = [ids for ids in servos if ids.esc is not None and 0 <= ids.esc - first < _BATCH]
    if not ours:
        return
    units = zip(_STATUS_FIELDS.values(), _TELEMETRY_UNITS, strict=True)
    values = np.stack([table[field] * unit for field, unit in units], axis=2)
    for ids in ours:
        k = (ids.esc or 0) - first
        there = (values[:, k] != 0).any(axis=1)  # a row of zeros is an absent ESC
        yield ids, ServoPart(f"{table.name}[{k}]", _STATUS_FIELDS, there, values[:, k])


def _servo_output(table: Table, servos: Sequence[ServoIds]) -> Split:
    """Yield the commands: ``port`` 0 and 1 are servos 1–16 and 17–32."""
    for ids in servos:
        port, k = divmod(ids.servo - 1, OUTPUTS)
        field = _SERVO_FIELDS[k]
        yield ids, ServoPart(table.name, {"pulse": field}, table["port"] == port, columns(table, field))


def _output_status(table: Table, servos: Sequence[ServoIds]) -> Split:
    for ids in servos:
        k = ids.servo - 1
        if k < _PER_STATUS:
            values = table["actuator"][:, k : k + 1].astype(np.float64)
            yield ids, ServoPart(table.name, {"pulse": f"actuator[{k}]"}, None, values)


SERVO_SOURCES: Final = (
    instrumented("DEBUG_FLOAT_ARRAY", "array_id"),
    ServoSource("esc-signed", "ESC_STATUS", _esc_status),
    named("NAMED_VALUE_FLOAT", "name", "value"),
    *(ServoSource("esc-unsigned", name, _esc_telemetry, signed=False) for name in _ESC_BATCHES),
    ServoSource("pwm", "SERVO_OUTPUT_RAW", _servo_output),
    ServoSource("pwm", "ACTUATOR_OUTPUT_STATUS", _output_status),
)

_ON_BOARD: Final = "judge the log on the autopilot's card ({}), or record"
REMEDIES: Final = {
    "motion": {
        ANY: (
            f"{_ON_BOARD.format('.BIN')} SERVO_OUTPUT_RAW, RAW_IMU and ATTITUDE at 10 Hz or more "
            f"({RATES}RC_CHAN, {RATES}RAW_SENS, {RATES}EXTRA1)"
        ),
        PX4: (
            f"{_ON_BOARD.format('.ulg')} SERVO_OUTPUT_RAW, HIGHRES_IMU and ATTITUDE at 10 Hz or more "
            "(MAV_x_MODE, MAV_x_RATE)"
        ),
    },
    "force": {
        ANY: f"{_ON_BOARD.format('.BIN')} RAW_IMU at 10 Hz or more ({RATES}RAW_SENS)",
        PX4: f"{_ON_BOARD.format('.ulg')} HIGHRES_IMU at 10 Hz or more (MAV_x_MODE, MAV_x_RATE)",
    },
}
