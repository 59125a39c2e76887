"""Where PX4's on-board log (ULog) keeps each fact. All times are of one clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.log import Table
from mavhums.vehicle.facts import IN_AIR, ON_GROUND, OUTPUTS, PX4, ServoIds
from mavhums.vehicle.formats.base import (
    ANY,
    TEXT,
    ServoPart,
    ServoSource,
    Source,
    Split,
    angles_of,
    bits_of,
    columns,
    instrumented,
    modes,
    named,
    plain,
    pulses,
    records_of_parameters,
    whole,
    wide,
)
from mavhums.vehicle.formats.mode_names import NAVIGATION_STATES

_ARMED: Final = 2  # vehicle_status.ARMING_STATE_ARMED
_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_VERSION_DIGITS: Final = 10  # of 2³²: a longer text is no version
_MAIN, _AUX = 0, 1  # places of actuator_outputs, see px4_buses
_ESCS: Final = 12  # in a record, and motors in a mask, at most
_DETECTOR: Final = "failure_detector_status"
_DETECTED: Final = ("fd_arm_escs", "fd_imbalanced_prop", "fd_motor", "motor_failure_mask")
_FIRST_SENSOR, _LAST_SENSOR = 1, 3  # airspeed_validated.SOURCE_SENSOR_1 and 3
_INFO: Final = {"name": TEXT, "value": TEXT}


def is_stamped(table: Table) -> bool:
    """Return True: every record has the time of the board's one clock."""
    return True


def mode_name(autopilot: int, kind: int, base_mode: int, number: int) -> str:
    """Return the name of a flight mode."""
    return NAVIGATION_STATES.get(number, f"Mode({number})")


def _outputs(table: Table) -> Array:
    return pulses(table["output"].astype(np.float64))


def _vector(fact: str, topic: str, field: str) -> Source:
    return Source(fact, topic, {field: 3}, lambda table: table[field].astype(np.float64))


def _state(table: Table) -> Array:
    armed = table["arming_state"] == _ARMED
    fields = (table["system_type"], np.full(len(table), PX4), armed, table["nav_state"])
    return np.stack([np.asarray(field, dtype=np.float64) for field in fields], axis=1)


def _autopilot(table: Table) -> NDArray[Any]:
    kind = table["system_type"].astype(np.int64)
    return np.stack([kind, np.full_like(kind, PX4)], axis=1)


def _landed(table: Table) -> Array:
    return np.where(table["landed"] != 0, float(ON_GROUND), float(IN_AIR))[:, None]


def _ground_speed(table: Table) -> Array:
    return np.asarray(np.hypot(table["vx"], table["vy"]).astype(np.float64)[:, None])


def _is_sensed(table: Table) -> Flags:
    """Return which airspeeds are a sensor's, not the ground speed less an estimated wind."""
    source = np.fmax(table.numbers("selected_airspeed_index"), table.numbers("airspeed_source"))
    return ~((source < _FIRST_SENSOR) | (source > _LAST_SENSOR))


def _has_version(table: Table) -> Flags:
    """Return which information records are a version: the log's own definitions may be arbitrary."""
    texts = zip(table["name"].tolist(), table["value"].tolist(), strict=True)
    return np.array(
        [
            name == b"ver_sw_release"
            and value.isdigit()
            and len(value) <= _VERSION_DIGITS
            and 0 < int(value) < 2**32
            for name, value in texts
        ],
        dtype=bool,
    )


def _versions(table: Table) -> NDArray[Any]:
    return np.array([int(value) for value in table["value"].tolist()], dtype=np.int64)


def _boards(table: Table) -> NDArray[Any]:
    return np.char.upper(table["value"])


def _parameters(table: Table) -> NDArray[Any]:
    integer = table["type"] == b"int32_t"
    bits = np.where(
        integer,
        np.where(integer, table["value"], 0).astype("<i4").view("<u4"),
        table["value"].astype("<f4").view("<u4"),
    )
    return records_of_parameters(table["name"], bits, np.where(integer, _INT32, _REAL32))


def _per_esc(table: Table, field: str) -> Array:
    """Return a field of each ESC in one record, shape (n, 12); 0 of those that it lacks."""
    return np.stack([np.nan_to_num(table.numbers(f"esc[{k}].{field}")) for k in range(_ESCS)], axis=1)


def _members(mask: Integers) -> Integers:
    """Return the bits of a mask as columns, shape (n, 12)."""
    return mask[:, None] >> np.arange(_ESCS) & 1


def _detected(table: Table) -> Integers:
    escs, propeller, motor, which = (table[field] for field in _DETECTED)
    none = np.zeros(len(table))
    return bits_of(none, none, escs, propeller, (motor != 0) & (which == 0))


def _supply(table: Table) -> Integers:
    """Return faults of the supply; the names of two fields changed their case."""
    lost = [table.numbers(f"{part}_valid") == 0 for part in ("brick", "servo")]
    over = [
        (table.numbers(f"{part}_5v_oc") > 0) | (table.numbers(f"{part}_5V_OC") > 0)
        for part in ("periph", "hipower")
    ]
    return bits_of(*lost, *over)


def _esc(table: Table, servos: Sequence[ServoIds]) -> Split:
    """Yield what up to eight ESCs in one record report."""
    for ids in servos:
        prefix = f"esc[{ids.esc}]."
        names = [prefix + field for field in _ESC_FIELDS.values()]
        if ids.esc is None or not table.holds(dict.fromkeys([prefix + "timestamp", *names], 1)):
            continue
        reported = table[prefix + "timestamp"] != 0  # an ESC that has not yet reported has 0
        yield ids, ServoPart(f"esc_status[{ids.esc}]", _ESC_FIELDS, reported, columns(table, *names))


def _commands(table: Table, servos: Sequence[ServoIds]) -> Split:
    """Yield the commands: place 0 is MAIN (servos 1–16), 1 AUX (17–32), 2 UAVCAN; see px4_buses."""
    if not table.holds({"output": OUTPUTS}):
        return
    for ids in servos:
        driver, k = divmod(ids.servo - 1, OUTPUTS)
        rows = table.component == driver
        if rows.any():
            values = table["output"][:, k : k + 1].astype(np.float64)
            yield ids, ServoPart(f"actuator_outputs[{driver}]", {"pulse": f"output[{k}]"}, rows, values)


NAME: Final = "ulog"
AUTOPILOT: Final = PX4
"""Which autopilot writes such logs."""

SOURCES: Final = (
    Source("outputs", "actuator_outputs", {"output": OUTPUTS}, _outputs, lambda t: t.component == _MAIN),
    Source(
        "outputs_2",
        "actuator_outputs",
        {"output": OUTPUTS},
        lambda t: wide(_outputs(t), OUTPUTS),
        lambda t: t.component == _AUX,
    ),
    _vector("rates", "sensor_combined", "gyro_rad"),
    _vector("rates", "vehicle_angular_velocity", "xyz"),
    _vector("force", "sensor_combined", "accelerometer_m_s2"),
    Source("attitude", "vehicle_attitude", {"q": 4}, lambda t: angles_of(t["q"])),
    plain("rates", "vehicle_attitude", "rollspeed", "pitchspeed", "yawspeed"),
    Source("demand", "vehicle_attitude_setpoint", {"q_d": 4}, lambda t: angles_of(t["q_d"])[:, :2]),
    plain("demand", "vehicle_attitude_setpoint", "roll_body", "pitch_body"),
    plain("airspeed", "airspeed", "indicated_airspeed_m_s"),
    plain("airspeed", "airspeed_validated", "indicated_airspeed_m_s", rows=_is_sensed),
    plain("velocity", "vehicle_local_position", "vx", "vy", "vz"),
    Source("groundspeed", "vehicle_local_position", {"vx": 1, "vy": 1}, _ground_speed),
    plain("altitude", "vehicle_local_position", "z", scale=-1.0),
    plain("altitude", "vehicle_air_data", "baro_alt_meter"),
    Source("state", "vehicle_status", {"arming_state": 1, "system_type": 1, "nav_state": 1}, _state),
    plain("vtol", "vtol_vehicle_status", "vehicle_vtol_state"),
    Source("landed", "vehicle_land_detected", {"landed": 1}, _landed),
    Source("mode", "vehicle_status", {"nav_state": 1}, lambda t: modes(t["nav_state"], PX4)),
    Source(
        "autopilot",
        "vehicle_status",
        {"system_type": 1},
        _autopilot,
        lambda t: np.asarray(t["system_type"] > 0),
    ),
    Source(
        "autopilot name", "info", _INFO, lambda t: t["value"], lambda t: np.asarray(t["name"] == b"sys_name")
    ),
    Source("firmware", "info", _INFO, _versions, _has_version),
    Source("board", "info", _INFO, _boards, lambda t: np.asarray(t["name"] == b"sys_uuid")),
    Source("uptime", "vehicle_status", {"timestamp": 1}, whole("timestamp")),
    Source("text", "logged_string", {"text": TEXT}, lambda t: t["text"]),
    Source("parameter", "parameter", {"name": TEXT, "type": TEXT, "value": 1}, _parameters),
    plain("position", "vehicle_global_position", "lat", "lon", "alt"),
    Source("ESC errors", "esc_status", {}, lambda t: _per_esc(t, "esc_errorcount").astype(np.int64)),
    Source("ESC faults", "esc_status", {}, lambda t: _per_esc(t, "failures").astype(np.int64)),
    Source(
        "ESC links",
        "esc_status",
        {"esc_count": 1, "esc_online_flags": 1},
        lambda t: (
            _members(~whole("esc_online_flags")(t)) * (np.arange(_ESCS) < whole("esc_count", column=True)(t))
        ),
    ),
    Source(
        "motor faults",
        _DETECTOR,
        {"motor_failure_mask": 1},
        lambda t: _members(whole("motor_failure_mask")(t)),
    ),
    Source("autopilot faults", _DETECTOR, dict.fromkeys(_DETECTED, 1), _detected),
    Source("supply faults", "system_power", {}, _supply),
    plain("sensed airspeed", "airspeed", "indicated_airspeed_m_s"),
    Source("named value", "debug_key_value", {"key": TEXT}, lambda t: t["key"]),
    Source("named value", "debug_vect", {"name": TEXT}, lambda t: t["name"]),
    Source("named value", "debug_array", {"name": TEXT}, lambda t: t["name"]),
)

_ESC_FIELDS: Final = {"V4": "esc_voltage", "V5": "esc_current", "V7": "esc_rpm"}

SERVO_SOURCES: Final = (
    instrumented("debug_array", "id"),
    ServoSource("esc-signed", "esc_status", _esc),
    named("debug_key_value", "key", "value"),
    ServoSource("pwm", "actuator_outputs", _commands),
)

REMEDIES: Final = {
    "motion": {
        ANY: (
            "record actuator_outputs, sensor_combined and vehicle_attitude at 10 Hz or more "
            "(SDLOG_PROFILE bits 0 and 4)"
        )
    },
    "force": {ANY: "record sensor_combined at 10 Hz or more (SDLOG_PROFILE bit 0)"},
}
