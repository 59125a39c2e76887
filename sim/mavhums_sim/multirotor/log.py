"""Writes a multirotor's flight as its autopilot sends it, ``.tlog``, and as it keeps it, ``.BIN``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._files import written_whole
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.tables import Table, boot_ms, boot_us, text_rows, whole
from mavhums_sim.dataflash import gps, records, write_records
from mavhums_sim.link import EPOCH_US, Link
from mavhums_sim.multirotor.escs import esc_records, rotor_rpm
from mavhums_sim.multirotor.flight import LOGGED_HZ, Flown

Array = NDArray[np.float64]

PARAMETERS: Final = {
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_SPIN_ARM": 0.1,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 1.0,
    "MOT_THST_EXPO": 0.65,
}
_ARDUPILOT: Final = 3
_ARMED: Final = 128 + 1
_LOITER: Final = 5
FUNCTIONS: Final = {f"SERVO{k + 1}_FUNCTION": 33.0 + k for k in range(8)}
"""The parameters that put each motor on the output of its number."""
_SCALE_MG: Final = 1000 / 9.80665
_SOFTWARE: Final = "ArduCopter V4.5.7 (simulated)"
_ARMED_S, _REST_S = 5.0, 12.0
"""The log begins on the ground: parameters come before the flight."""


class Rates(NamedTuple):
    """Rates of the streams, Hz; 0 for none."""

    outputs: float = 10.0
    attitude: float = 10.0
    imu: float = 10.0
    position: float = 4.0
    esc: float = 0.0


def pulses(command: Array) -> Array:
    """Return the pulses of the motors, µs, whole, for thrusts asked of them, shares from 0 to 1.

    The autopilot inverts the thrust curve (1 − e)·x + e·x² of its parameters.
    """
    e, idle = PARAMETERS["MOT_THST_EXPO"], PARAMETERS["MOT_SPIN_MIN"]
    x = (np.sqrt((1 - e) ** 2 + 4 * e * command) - (1 - e)) / (2 * e)
    rounded: Array = np.rint(1000 + 1000 * (idle + (1 - idle) * x))
    return rounded


def sampled(rng: np.random.Generator, flown: Flown, rate_hz: float) -> tuple[Array, NDArray[np.int64]]:
    """Return the times at which a stream samples the flight, s, and the rows that it sends."""
    period = 1.0 / rate_hz
    times = np.arange(rng.uniform(0, period), flown.time_s[-1], period)
    times = times + rng.uniform(-0.1, 0.1, times.size) * period
    times = np.clip(times, 0.0, flown.time_s[-1])
    return times, np.floor(times * LOGGED_HZ).astype(np.int64)


def report(flown: Flown, rates: Rates, seed: int) -> list[Table]:
    """Return the messages of a flight; the flight begins after 12 s on the ground."""
    rng = np.random.default_rng([seed, 6])
    frame, motors = flown.craft.frame, flown.craft.gains.size
    numbers = _numbers(flown)
    beats = np.arange(0.0, _REST_S + flown.time_s[-1], 1.0)
    heartbeat = {
        "type": frame.mav_type,
        "autopilot": _ARDUPILOT,
        "base_mode": np.where(beats < _ARMED_S, 1, _ARMED),
        "custom_mode": _LOITER,
        "mavlink_version": 3,
    }
    sent = np.linspace(0.5, 2.0, len(numbers))
    values = {
        "param_id": np.array([name.encode() for name in numbers], "S16"),
        "param_value": np.array(list(numbers.values())),
        "param_type": 9,
        "param_count": len(numbers),
        "param_index": np.arange(len(numbers)),
    }
    tables = [
        Table("HEARTBEAT", beats, heartbeat),
        Table("PARAM_VALUE", sent, values),
        text_rows([(0.4, _SOFTWARE)]),
    ]
    whole_log = _with_ground(flown)
    time_s, rows = sampled(rng, whole_log, rates.outputs)
    sent_us = pulses(whole_log.command[rows])
    columns = {f"servo{k + 1}_raw": sent_us[:, k] for k in range(motors)}
    tables.append(Table("SERVO_OUTPUT_RAW", time_s, {"time_usec": boot_us(time_s) % 2**32, **columns}))
    time_s, rows = sampled(rng, whole_log, rates.attitude)
    names = ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed")
    angles = whole_log.attitude[rows].copy()
    angles[:, 2] = np.angle(np.exp(1j * angles[:, 2]))
    both = np.concatenate([angles, whole_log.rates[rows]], axis=1)
    turning = {name: both[:, k] for k, name in enumerate(names)}
    tables.append(Table("ATTITUDE", time_s, {"time_boot_ms": boot_ms(time_s), **turning}))
    time_s, rows = sampled(rng, whole_log, rates.imu)
    moved = {f"{axis}gyro": whole(whole_log.rates[rows, k] * 1000) for k, axis in enumerate("xyz")}
    moved |= {f"{axis}acc": whole(whole_log.force[rows, k] * _SCALE_MG) for k, axis in enumerate("xyz")}
    tables.append(Table("RAW_IMU", time_s, {"time_usec": boot_us(time_s), **moved}))
    if rates.esc:
        tables.extend(_speeds(flown, rates.esc, seed))
    time_s, rows = sampled(rng, whole_log, rates.position)
    height, speed = whole_log.position[rows, 2], whole_log.velocity[rows]
    where = {
        "time_boot_ms": boot_ms(time_s),
        "lat": whole(47e7 + whole_log.position[rows, 0] * 90.0, -(2**31), 2**31 - 1),
        "lon": whole(8e7 + whole_log.position[rows, 1] * 130.0, -(2**31), 2**31 - 1),
        "alt": whole(height * 1000 + 400_000, -(2**31), 2**31 - 1),
        "relative_alt": whole(height * 1000, -(2**31), 2**31 - 1),
        "vx": whole(speed[:, 0] * 100),
        "vy": whole(speed[:, 1] * 100),
        "vz": whole(speed[:, 2] * -100),
    }
    return [*tables, Table("GLOBAL_POSITION_INT", time_s, where)]


def _speeds(flown: Flown, rate_hz: float, seed: int) -> list[Table]:
    """Return what the ESCs report: a speed by the root of the thrust, less where not the propeller fails."""
    rng = np.random.default_rng([seed, 9])
    rpm = rotor_rpm(flown)
    time_s, rows = sampled(rng, flown, rate_hz)
    speeds = rpm[rows] * (1.0 + rng.normal(0.0, 0.01, rpm[rows].shape))
    tables = []
    for first in range(0, speeds.shape[1], 4):
        rpm, voltage = np.zeros((2, len(rows), 4))
        part = speeds[:, first : first + 4]
        rpm[:, : part.shape[1]], voltage[:, : part.shape[1]] = part, 1480.0
        columns = {"rpm": whole(rpm), "voltage": whole(voltage)}
        tables.append(Table(f"ESC_TELEMETRY_{first + 1}_TO_{first + 4}", time_s + _REST_S, columns))
    return tables


def write_tlog(
    flown: Flown,
    path: Path,
    rates: Rates | None = None,
    seed: int = 0,
) -> None:
    """Write a flight's ``.tlog`` atomically; the flight begins after 12 s on the ground.

    Raises
    ------
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    data = encode(report(flown, rates or Rates(), seed), seed, Link())
    with written_whole(path) as temporary:
        temporary.write_bytes(data)


def write_dataflash(
    flown: Flown,
    path: Path,
    rates: Rates | None = None,
    seed: int = 0,
) -> None:
    """Write a flight's ``.BIN`` atomically; the flight begins after 12 s on the ground.

    Raises
    ------
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    rates, rng = rates or Rates(), np.random.default_rng([seed, 7])
    numbers, log = _numbers(flown), _with_ground(flown)
    start, seconds = np.zeros(1), np.arange(0.0, log.time_s[-1], 1.0)
    names = np.array([name.encode() for name in numbers], "S16")
    kinds = [
        records("PARM", np.zeros(len(numbers)), Name=names, Value=np.array(list(numbers.values()))),
        records("MSG", start, Message=_SOFTWARE.encode()),
        records("MODE", start, Mode=_LOITER, ModeNum=_LOITER, Rsn=1),
        records("STAT", seconds, isFlying=seconds >= _REST_S, Armed=seconds >= _ARMED_S),
        gps(seconds, EPOCH_US),
    ]
    for kind in esc_records(flown, rates.esc, seed) if rates.esc else []:
        kind.rows["TimeUS"] += np.uint64(round(_REST_S * 1e6))
        kinds.append(kind._replace(time_s=kind.time_s + _REST_S))
    time_s, rows = sampled(rng, log, rates.outputs)
    sent_us = pulses(log.command[rows])
    kinds.append(records("RCOU", time_s, **{f"C{k + 1}": sent_us[:, k] for k in range(sent_us.shape[1])}))
    time_s, rows = sampled(rng, log, rates.attitude)
    roll, pitch, yaw = np.degrees(log.attitude[rows]).T
    kinds.append(records("ATT", time_s, Roll=roll, Pitch=pitch, Yaw=yaw % 360))
    time_s, rows = sampled(rng, log, rates.imu)
    turning = {f"Gyr{axis}": log.rates[rows, k] for k, axis in enumerate("XYZ")}
    force = {f"Acc{axis}": log.force[rows, k] for k, axis in enumerate("XYZ")}
    kinds.append(records("IMU", time_s, **turning, **force))
    time_s, rows = sampled(rng, log, rates.position)
    kinds.append(records("POS", time_s, RelHomeAlt=log.position[rows, 2]))
    write_records(kinds, path)


def _numbers(flown: Flown) -> dict[str, float]:
    """Return the autopilot's parameters."""
    frame = flown.craft.frame
    numbers = {**PARAMETERS, "FRAME_CLASS": frame.parameters[0], "FRAME_TYPE": frame.parameters[1]}
    return numbers | dict(list(FUNCTIONS.items())[: flown.craft.gains.size])


def _with_ground(flown: Flown) -> Flown:
    """Return the flight with the wait on the ground before it, motors at idle."""
    rows = int(_REST_S * LOGGED_HZ)

    def before(values: Array, fill: Array) -> Array:
        return np.concatenate([np.broadcast_to(fill, (rows, values.shape[1])), values])

    return dataclasses.replace(
        flown,
        time_s=np.arange(rows + flown.time_s.size) / LOGGED_HZ,
        attitude=before(flown.attitude, flown.attitude[0]),
        rates=before(flown.rates, np.zeros(3)),
        position=before(flown.position, np.zeros(3)),
        velocity=before(flown.velocity, np.zeros(3)),
        force=before(flown.force, np.array([0.0, 0.0, -9.80665])),
        command=before(flown.command, np.zeros(1)),
        wanted=before(flown.wanted, np.zeros(2)),
    )
