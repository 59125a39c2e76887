"""Writer of the on-board log: ArduPilot's DataFlash (``.BIN``).

Each record is ``A3 95``, a type and a payload; FMT records at the start define the types. The aircraft
records on board, without a link, so nothing is lost or late. CSRV is written as ArduPilot 4.7 does for a
servo that the autopilot itself drives: counted from 0, with the command in the record.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mavhums_sim._arrays import Array, Records
from mavhums_sim.flight import Flight, FlightRecord
from mavhums_sim.link import BOOT_US, EPOCH_US
from mavhums_sim.sensors import sample_times
from mavhums_sim.telemetry import board, parameters
from mavhums_sim.tiers import servo_pulses

ON_BOARD_TIERS = ("csrv", "esc-unsigned", "named", "pwm")
"""Tiers that an on-board log can carry."""

_LETTERS = {"Q": "<u8", "B": "u1", "H": "<u2", "h": "<i2", "I": "<u4", "i": "<i4", "f": "<f4", "L": "<i4",
            "e": "<i4", "n": "S4", "N": "S16", "Z": "S64", "M": "u1", "a": "(32,)<i2"}  # fmt: skip
_TYPES = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": (65, "QZ", "TimeUS,Message"),
    "MODE": (66, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "GPS": (67, "QBBIHBhLLe", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt"),
    "ATT": (68, "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "ARSP": (69, "QBf", "TimeUS,I,Airspeed"),
    "STAT": (70, "QBfBB", "TimeUS,isFlying,isFlyProb,Armed,Safety"),
    "RCOU": (71, "Q" + 14 * "H", "TimeUS," + ",".join(f"C{n}" for n in range(1, 15))),
    "ESC": (72, "QBffffhfhf", "TimeUS,Instance,RPM,RawRPM,Volt,Curr,Temp,CTot,MotTemp,Err"),
    "NVF": (73, "QNf", "TimeUS,Name,Value"),
    "CSRV": (74, "QBfffBfffffB", "TimeUS,Id,Pos,Force,Speed,Pow,PosCmd,V,A,MotT,PCBT,Err"),
    "DSF": (75, "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv"),
    "IMU": (76, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ACC": (80, "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
    "EDT2": (81, "QBBBB", "TimeUS,Instance,Stress,MaxStress,Status"),
    "POS": (77, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
}
_GPS_EPOCH_US = 315_964_800_000_000  # 1980-01-06
_LEAP_S = 18
_WEEK_MS = 7 * 86_400_000
_AUTO = 10
_UP_TO_DATE, _STALLS = 2, 16  # of EDT2's status
_VOLTS, _AMPERES, _SPEED = 0, 1, 2


class Kind(NamedTuple):
    """Records of one type: their times in the flight, s, and the records themselves."""

    name: str
    time_s: Array
    rows: Records


def write_dataflash(record: FlightRecord, path: Path, *, day: float = 0.0) -> dict[str, int]:
    """Write the flight's ``.BIN`` atomically and return the number of records by type.

    Parameters
    ----------
    day
        Start of the flight, days after 2026-01-01 09:00 UTC.

    Raises
    ------
    ValueError
        If the flight has a tier that an on-board log cannot carry.
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    wrong = set(record.flight.tiers) - set(ON_BOARD_TIERS)
    if wrong:
        known = ", ".join(ON_BOARD_TIERS)
        raise ValueError(f"an on-board log has no tier {sorted(wrong)[0]!r}; it has {known}")
    return write_records(list(_kinds(record, EPOCH_US + round(day * 86_400e6))), path)


def write_records(kinds: Sequence[Kind], path: Path) -> dict[str, int]:
    """Write a ``.BIN`` of these records atomically, and return the number of records by type.

    Raises
    ------
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    time_s = np.concatenate([kind.time_s for kind in kinds])
    owner = np.repeat(np.arange(len(kinds)), [kind.time_s.size for kind in kinds])
    place = np.concatenate([np.arange(kind.time_s.size) for kind in kinds])
    data = [kind.rows.tobytes() for kind in kinds]
    sizes = [kind.rows.dtype.itemsize for kind in kinds]
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            file.write(_definitions().tobytes())
            for k in np.argsort(time_s, kind="stable").tolist():
                begin = int(place[k]) * sizes[owner[k]]
                file.write(data[owner[k]][begin : begin + sizes[owner[k]]])
        os.replace(partial, path)  # noqa: PTH105 - atomic, and says so
    finally:
        partial.unlink(missing_ok=True)
    counts: dict[str, int] = {"FMT": len(_TYPES)}
    for kind in kinds:
        counts[kind.name] = counts.get(kind.name, 0) + kind.time_s.size
    return counts


def _wire(name: str) -> np.dtype[np.void]:
    _, letters, columns = _TYPES[name]
    fields = [(column, _LETTERS[letter]) for column, letter in zip(columns.split(","), letters, strict=True)]
    return np.dtype([("head", "S3"), *fields])


def records(name: str, time_s: Array, **columns: object) -> Kind:
    """Return records with the given columns; the others are zero, and floats among them NaN."""
    rows = np.zeros(time_s.size, dtype=_wire(name))
    rows["head"] = bytes([0xA3, 0x95, _TYPES[name][0]])
    for field in rows.dtype.names or ():
        if rows.dtype[field].kind == "f":
            rows[field] = np.nan
    rows["TimeUS"] = BOOT_US + np.rint(time_s * 1e6).astype(np.int64)
    for field, values in columns.items():
        rows[field] = values
    return Kind(name, time_s, rows)


def _definitions() -> Records:
    rows = np.zeros(len(_TYPES), dtype=_wire("FMT"))
    rows["head"] = bytes([0xA3, 0x95, 128])
    for k, (name, (number, letters, columns)) in enumerate(_TYPES.items()):
        head_and_fields = (number, _wire(name).itemsize, name, letters, columns)
        for field, value in zip(_TYPES["FMT"][2].split(","), head_and_fields, strict=True):
            rows[field][k] = value
    return rows


def _kinds(record: FlightRecord, epoch_us: int) -> Iterator[Kind]:
    flight, rng = record.flight, np.random.default_rng([record.flight.seed, 11])

    def at(rate_hz: float) -> Array:
        return sample_times(rng, flight.duration_s, rate_hz)

    yield from _opening(flight)
    yield gps(at(5.0), epoch_us)
    yield from _state(record, at(flight.rates.attitude), at(flight.rates.air_data))
    seconds = np.arange(0.0, flight.duration_s, 1.0, dtype=np.float64)
    yield records("STAT", seconds, isFlying=1, isFlyProb=1.0, Armed=1)
    yield records("DSF", seconds)
    if "pwm" in flight.tiers:
        yield _outputs(record, at(flight.rates.servo_output))
    for k, surface in enumerate(record.actuators):
        yield from _actuator(record, surface, k)


def _opening(flight: Flight) -> Iterator[Kind]:
    rows = parameters()
    names, values = np.array([name for name, _ in rows], dtype="S16"), np.array([v for _, v in rows])
    yield records("PARM", np.zeros(len(rows)), Name=names, Value=values, Default=values)
    texts = np.array(["ArduPlane V4.7.0 (simulated)", board(flight)], dtype="S64")
    yield records("MSG", np.zeros(texts.size), Message=texts)
    announced = np.arange(0.0, flight.duration_s, 10.0, dtype=np.float64)
    yield records("MSG", announced, Message=b"mavhums airframe=paper")
    yield records("MODE", np.zeros(1), Mode=_AUTO, ModeNum=_AUTO, Rsn=1)


def gps(time_s: Array, epoch_us: int) -> Kind:
    """Return fixes at these times; they give the time of day."""
    utc_us = epoch_us + np.rint(time_s * 1e6).astype(np.int64)
    weeks, milliseconds = np.divmod((utc_us - _GPS_EPOCH_US) // 1000 + _LEAP_S * 1000, _WEEK_MS)
    # The fix is of a whole millisecond; the record is stamped when it was valid.
    rounded_s = time_s - (utc_us % 1000) * 1e-6
    return records("GPS", rounded_s, Status=3, GMS=milliseconds, GWk=weeks, NSats=12, HDop=80)


def _state(record: FlightRecord, attitude_s: Array, air_s: Array) -> Iterator[Kind]:
    flown = record.cyclogram
    roll, pitch, yaw = (
        np.degrees(np.interp(attitude_s, flown.time_s, signal))
        for signal in (flown.roll, flown.pitch, flown.yaw)
    )
    yield records("ATT", attitude_s, Roll=roll, Pitch=pitch, Yaw=yaw % 360)
    yield records("ARSP", air_s, Airspeed=np.interp(air_s, flown.time_s, flown.airspeed))


def _outputs(record: FlightRecord, time_s: Array) -> Kind:
    pulses = np.rint(servo_pulses(record, time_s)).astype(np.uint16)
    return records("RCOU", time_s, **{f"C{k + 1}": pulses[:, k] for k in range(pulses.shape[1])})


def _actuator(record: FlightRecord, surface: str, k: int) -> Iterator[Kind]:
    flight, actuator = record.flight, record.actuators[surface]
    time_s, values, esc = actuator.time_s, actuator.values, actuator.esc
    degrees = actuator.temperature(flight.parameters, time_s)
    if "csrv" in flight.tiers:
        own: Mapping[str, object] = {
            "PosCmd": values[:, 0], "Pos": values[:, 2], "V": esc[:, _VOLTS], "A": esc[:, _AMPERES],
            "Speed": values[:, 9] * 6, "Force": values[:, 10], "Pow": 255, "MotT": degrees,
        }  # fmt: skip
        yield records("CSRV", time_s, Id=k, Err=actuator.stuck(flight.parameters, time_s), **own)
    if "esc-unsigned" in flight.tiers:
        volts, amperes, speed = np.abs(esc[:, [_VOLTS, _AMPERES, _SPEED]]).T
        yield records("ESC", time_s, Instance=k, RPM=speed, Volt=volts, Curr=amperes, Temp=np.rint(degrees))
        seconds = np.arange(0.5, flight.duration_s, 1.0, dtype=np.float64)
        status = _UP_TO_DATE + _STALLS * actuator.stuck(flight.parameters, seconds)
        yield records("EDT2", seconds, Instance=k, Status=status)
    if "named" in flight.tiers:
        for quantity in range(values.shape[1]):
            name = f"S{k + 1}V{quantity + 1:02d}".encode()
            yield records("NVF", time_s, Name=name, Value=values[:, quantity])
