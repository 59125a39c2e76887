"""Where ArduPilot's on-board log (DataFlash) keeps each fact.

The first of several sensors is used (``I`` = 0). The state has no record of its own: STAT says whether the
vehicle is armed, where it is not Plane's ARM and EV say when it arms and disarms; MODE gives the mode, and a
text of the firmware the kind of vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.log import Table
from mavhums.vehicle.facts import ALL_OUTPUTS, ARDUPILOT, IN_AIR, ON_GROUND, OUTPUTS, ServoIds
from mavhums.vehicle.formats.base import (
    ANY,
    TEXT,
    ServoPart,
    ServoSource,
    Source,
    Split,
    bits_of,
    columns,
    holds,
    modes,
    named,
    plain,
    pulses,
    records_of_parameters,
    supply_faults,
    whole,
)
from mavhums.vehicle.formats.mode_names import ardupilot_mode

_FIX: Final = 3  # GPS_STATUS of a three-dimensional fix: before it, speed and course are noise
_REAL32: Final = 9  # MAV_PARAM_TYPE
_ARMS, _DISARMS = 10, 11  # events of EV


def is_stamped(table: Table) -> bool:
    """Return True: every record has the time of the board's one clock."""
    return True


def mode_name(autopilot: int, kind: int, base_mode: int, number: int) -> str | None:
    """Return the name of a flight mode; None before a text has named the kind of vehicle."""
    return ardupilot_mode(kind, number) if kind >= 0 else None


def _first_sensor(table: Table) -> Flags:
    return ~(table.numbers("I") > 0)


def _channel(table: Table, number: int) -> str | None:
    """Return the field of an output, which Copter before 3.4 names ``Ch``; None without one."""
    return next((field for field in (f"C{number}", f"Ch{number}") if table.holds({field: 1})), None)


def _outputs(count: int) -> Any:
    """Return what reads the pulses of the first ``count`` outputs; a record has only some of them."""

    def read(table: Table) -> Array:
        sent = np.full((len(table), count), np.nan)
        for k in range(count):
            field = _channel(table, k + 1)
            if field is not None:
                sent[:, k] = table[field]
        return pulses(sent)

    return read


def _velocity(table: Table) -> Array:
    speed, course = table["Spd"].astype(np.float64), np.radians(table["GCrs"].astype(np.float64))
    down = np.nan_to_num(table.numbers("VZ"))
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course), down], axis=1)
    return np.where((table["Status"] >= _FIX)[:, None], velocity, np.nan)


def _angles(fact: str, *fields: str) -> Source:
    widths = dict.fromkeys(fields, 1)
    return Source(fact, "ATT", widths, lambda table: np.radians(columns(table, *fields)))


def _armed(table: Table) -> Array:
    return np.stack([np.full(len(table), float(ARDUPILOT)), table["Armed"] > 0], axis=1)


def _arming(table: Table) -> Array:
    armed = table["ArmState"] > 0 if table.holds({"ArmState": 1}) else table["Id"] == _ARMS
    return np.stack([np.full(len(table), float(ARDUPILOT)), armed], axis=1)


def _landed(table: Table) -> Array:
    return np.where(table["isFlying"] > 0, float(IN_AIR), float(ON_GROUND))[:, None]


def _parameters(table: Table) -> NDArray[Any]:
    bits = np.ascontiguousarray(table["Value"].astype("<f4")).view("<u4")
    return records_of_parameters(table["Name"], bits, _REAL32)


_LANDINGS: Final = {18: ON_GROUND, 28: IN_AIR}  # of events: landed, not landed


def _csrv_place(table: Table) -> Integers:
    """Return the outputs, from 0, of servo records, shape (n,): see ``_csrv``."""
    return (table.numbers("Id") + np.isfinite(table.numbers("PosCmd"))).astype(np.int64) - 1


def _landing(table: Table) -> Array:
    return np.array([float(_LANDINGS[number]) for number in table["Id"].tolist()])[:, None]


_STATUS: Final = whole("Status")
_FIRST_STATUS: Final = 10
"""Of the faults of an ESC: DShot's extended telemetry has alert, warning and error in bits 2 to 4."""


_STAT: Final = {"Armed": 1, "isFlying": 1}

NAME: Final = "dataflash"
AUTOPILOT: Final = ARDUPILOT
"""Which autopilot writes such logs."""

SOURCES: Final = (
    Source("armed", "STAT", _STAT, _armed),
    Source("arming", "ARM", {"ArmState": 1}, _arming),
    Source("arming", "EV", {"Id": 1}, _arming, lambda t: np.isin(t["Id"], (_ARMS, _DISARMS))),
    Source("landed", "STAT", _STAT, _landed),
    Source("outputs", "RCOU", {}, _outputs(OUTPUTS)),
    Source("landed", "EV", {"Id": 1}, _landing, lambda t: np.isin(t["Id"], [*_LANDINGS])),
    Source("outputs_2", "RCO2", {}, _outputs(ALL_OUTPUTS)),
    Source("outputs_3", "RCO3", {}, _outputs(ALL_OUTPUTS)),
    plain("rates", "IMU", "GyrX", "GyrY", "GyrZ", rows=_first_sensor),
    plain("force", "IMU", "AccX", "AccY", "AccZ", rows=_first_sensor),
    plain("mixer", "RATE", "ROut", "POut", "YOut", "AOut"),
    _angles("attitude", "Roll", "Pitch", "Yaw"),
    _angles("demand", "DesRoll", "DesPitch"),
    plain("airspeed", "ARSP", "Airspeed", rows=_first_sensor),
    Source("velocity", "GPS", {"Status": 1, "Spd": 1, "GCrs": 1}, _velocity, _first_sensor),
    plain("groundspeed", "GPS", "Spd", rows=_first_sensor),
    plain("altitude", "POS", "RelHomeAlt"),
    plain("altitude", "CTUN", "Alt"),
    plain("altitude", "BARO", "Alt", rows=_first_sensor),
    Source("altitude error", "TECS", {"h": 1, "hdem": 1}, lambda t: (t["hdem"] - t["h"])[:, None]),
    Source("mode", "MODE", {"ModeNum": 1}, lambda t: modes(t["ModeNum"], ARDUPILOT)),
    Source("text", "MSG", {"Message": TEXT}, lambda t: t["Message"]),
    Source("uptime", "MSG", {"TimeUS": 1}, whole("TimeUS")),
    Source("uptime", "PARM", {"TimeUS": 1}, whole("TimeUS")),
    Source("parameter", "PARM", {"Name": TEXT, "Value": 1}, _parameters),
    plain("position", "POS", "Lat", "Lng", "Alt"),
    plain("sensed airspeed", "ARSP", "Airspeed", rows=_first_sensor),
    Source(
        "ESC telemetry",
        "ESC",
        {"Instance": 1, "Err": 1},
        lambda t: bits_of(t["Err"] > 50.0),
        first=whole("Instance"),
    ),
    Source(
        "ESC faults",
        "EDT2",
        {"Instance": 1, "Status": 1},
        lambda t: ((_STATUS(t) >> 2 & 7) << _FIRST_STATUS)[:, None],
        lambda t: _STATUS(t) & 2 > 0,  # it is up to date
        first=whole("Instance"),
    ),
    Source("ESC errors", "CESC", {"Id": 1, "ECnt": 1}, whole("ECnt", column=True), first=whole("Id")),
    Source("servo flags", "CSRV", {"Id": 1, "Err": 1}, whole("Err", column=True), first=_csrv_place),
    Source("supply faults", "POWR", {"Flags": 1}, lambda t: supply_faults(whole("Flags")(t))),
    plain("servo rail", "POWR", "VServo"),
    Source("named value", "NVF", {"Name": TEXT}, lambda t: t["Name"]),
)

# Servo telemetry

_ESC_FIELDS: Final = {"V4": "Volt", "V5": "Curr", "V7": "RPM"}
_CSRV_DEGREES: Final = {
    "PosCmd": ("V1", 1.0),
    "Pos": ("V3", 1.0),
    "V": ("V4", 1.0),
    "A": ("V5", 1.0),
    "Speed": ("V10", 1 / 6),
}
_CSRV_RADIANS: Final = {"Pos": ("V3", 180 / pi), "Speed": ("V10", 30 / pi)}
"""ArduPilot before 4.7 logs no command, and the angle in radians.

The unit of Force depends on the servo's maker: only a profile that maps it makes it a load.
"""


def _csrv(table: Table, servos: Sequence[ServoIds]) -> Split:
    """Yield what servos measure; the fields that a servo does not fill are NaN.

    A serial Volz servo gives position, command, voltage and current; a DroneCAN servo gives position, torque
    and speed. The number is the output counted from 0 if the autopilot itself drives the servo (the record
    then has its command), and from 1 on DroneCAN, whose servos do not repeat the command.
    """
    gives = _CSRV_DEGREES if table.holds({"PosCmd": 1}) else _CSRV_RADIANS
    fields = {field: gives[field] for field in gives if table.holds({field: 1})}
    if not fields:
        return
    number, servo = table.numbers("Id"), _csrv_place(table) + 1
    values = np.stack([table.numbers(field) * scale for field, (_, scale) in fields.items()], axis=1)
    values[~np.isfinite(values)] = np.nan
    named = [ids.record for ids in servos if ids.record is not None]
    for ids in servos:
        by_channel = (servo == ids.servo) & ~np.isin(number, named)
        rows = by_channel if ids.record is None else number == ids.record
        if rows.any():
            label = f"CSRV[{number[rows.argmax()]:.0f}]"
            yield ids, ServoPart(label, {key: field for field, (key, _) in fields.items()}, rows, values)


def _esc(table: Table, servos: Sequence[ServoIds]) -> Split:
    """Yield magnitudes: most ESCs report no signs, and no record distinguishes those that do."""
    if not holds(table, dict.fromkeys(("Instance", *_ESC_FIELDS.values()), 1)):
        return
    values = np.abs(columns(table, *_ESC_FIELDS.values()))
    for ids in servos:
        if ids.esc is not None:
            yield ids, ServoPart(f"ESC[{ids.esc}]", _ESC_FIELDS, table["Instance"] == ids.esc, values)


def _commands(table: Table, servos: Sequence[ServoIds]) -> Split:
    for ids in servos:
        field = _channel(table, ids.servo)
        if field is not None:
            yield ids, ServoPart(table.name, {"pulse": field}, None, columns(table, field))


SERVO_SOURCES: Final = (
    ServoSource("csrv", "CSRV", _csrv),
    named("NVF", "Name", "Value"),
    ServoSource("esc-unsigned", "ESC", _esc, signed=False),
    *(ServoSource("pwm", name, _commands) for name in ("RCO2", "RCO3", "RCOU")),
)

REMEDIES: Final = {
    "motion": {
        ANY: "record RCOU, ATT and IMU at 10 Hz or more (LOG_BITMASK bits 13, 0 and 7, LOG_FILE_RATEMAX 0)"
    },
    "force": {ANY: "record IMU at 10 Hz or more (LOG_BITMASK bit 7)"},
}
