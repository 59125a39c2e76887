"""Replay of a real log: its servo commands and airspeed drive the simulated actuators.

Motion and load of the actuators are then those of a real flight.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim._arrays import Array
from mavhums_sim.cyclogram import SURFACES, Cyclogram
from mavhums_sim.motion import CONTROL_PERIOD_S

Between = Literal["linear", "hold"]
_NAMES = {  # SERVOn_FUNCTION of ArduPilot: the nth such output drives the nth surface named
    4: ("aileron_left", "aileron_right"),
    24: ("aileron_left",),
    25: ("aileron_right",),
    77: ("aileron_left",),
    78: ("aileron_right",),
    19: ("elevator",),
    79: ("elevator",),
    21: ("rudder",),
    80: ("rudder",),
}
_DEGREES_PER_PULSE = 60.0 / 500.0
_LONGEST_S = 36_000.0
_WANTED = ["SERVO_OUTPUT_RAW", "VFR_HUD", "ATTITUDE", "PARAM_VALUE"]


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A log converted to a cyclogram.

    Attributes
    ----------
    channels
        Servo output of each surface; surfaces without one stay at 0°.
    rate_hz
        Commands per second in the log; between them they are interpolated.
    """

    cyclogram: Cyclogram
    channels: dict[str, int]
    rate_hz: float


def replay(path: Path, channels: Mapping[str, int] | None = None, between: Between = "linear") -> Replay:
    """Read the commands, airspeed and attitude of a ``.tlog``.

    A pulse of 1500 µs (or SERVOn_TRIM) ±500 µs is ±60° of the servo. Angle of attack is pitch minus
    flight path angle, limited to ±15°; sideslip is unknown and assumed zero.

    Parameters
    ----------
    channels
        Servo output (1…16) per surface; by default according to the log's SERVOn_FUNCTION parameters.
    between
        Interpolation between two commands: ``linear``, or ``hold`` for the last one. The true command
        lies between these, because autopilots command faster than logs record.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it has no servo outputs, or no output is assigned to a surface.
    """
    log = _read(path)
    if len(log.servo) < 2:
        raise ValueError(f"{path}: no SERVO_OUTPUT_RAW, so no commands to replay")
    channels = dict(channels) if channels else _channels(log.parameters)
    if not channels:
        raise ValueError(
            f"{path}: no SERVOn_FUNCTION parameter names a surface; "
            "name the outputs, for example --channel elevator=2"
        )
    servo = np.array(log.servo)
    servo = servo[_increasing(servo[:, 0])]
    start, end = servo[0, 0], min(servo[-1, 0], servo[0, 0] + _LONGEST_S)
    periods = np.arange(int((end - start) / CONTROL_PERIOD_S), dtype=np.float64)
    time = (periods + 1.0) * CONTROL_PERIOD_S
    if time.size < 1.0 / CONTROL_PERIOD_S:
        raise ValueError(f"{path}: less than a second of commands")
    commands = {s: np.zeros_like(time) for s in SURFACES}
    for surface, channel in channels.items():
        trim = log.parameters.get(f"SERVO{channel}_TRIM", 1500.0)
        usable = servo[:, channel] > 500.0  # 0 is no pulse: the output is off
        if not usable.any():
            raise ValueError(f"{path}: output {channel} ({surface}) never sends a pulse")
        angle = np.clip((servo[usable, channel] - trim) * _DEGREES_PER_PULSE, -60.0, 60.0)
        commands[surface] = np.radians(_joined(time + start, servo[usable, 0], angle, between))
    airspeed, climb, altitude = _sampled(time + start, log.air, 3)
    roll, pitch, yaw = _sampled(time + start, log.attitude, 3)
    path_angle = np.arcsin(np.clip(climb / np.maximum(airspeed, 5.0), -1.0, 1.0))
    attack = np.where(airspeed > 5.0, np.clip(pitch - path_angle, -np.radians(15.0), np.radians(15.0)), 0.0)
    incidence = {s: np.zeros_like(time) if s == "rudder" else attack for s in SURFACES}
    cyclogram = Cyclogram(
        f"replay of {path.name}",
        time,
        commands,
        np.maximum(airspeed, 0.0),
        incidence,
        roll,
        pitch,
        yaw,
        altitude - altitude.min(),
    )
    return Replay(cyclogram, channels, float(len(servo) / time[-1]))


@dataclass(slots=True)
class _Log:
    servo: list[list[float]] = field(default_factory=list)
    air: list[list[float]] = field(default_factory=list)
    attitude: list[list[float]] = field(default_factory=list)
    parameters: dict[str, float] = field(default_factory=dict)


def _read(path: Path) -> _Log:
    """Messages of the vehicle with the most servo output messages."""
    by_vehicle: dict[tuple[int, int], _Log] = {}
    outputs: Counter[tuple[int, int]] = Counter()
    connection = mavutil.mavlogfile(str(path))
    try:
        connection.mav = mavlink.MAVLink(connection)  # reads both versions, whichever comes first
        connection.mav.robust_parsing = True
        connection.first_byte = False
        while (message := connection.recv_match(type=_WANTED)) is not None:
            vehicle = message.get_srcSystem(), message.get_srcComponent()
            _keep(by_vehicle.setdefault(vehicle, _Log()), message)
            outputs[vehicle] += message.get_type() == "SERVO_OUTPUT_RAW"
    finally:
        connection.f.close()
    return by_vehicle[outputs.most_common(1)[0][0]] if outputs else _Log()


def _keep(log: _Log, message: Any) -> None:
    now, kind = message._timestamp, message.get_type()
    if kind == "PARAM_VALUE":
        log.parameters[message.param_id] = message.param_value
    elif kind == "VFR_HUD":
        log.air.append([now, message.airspeed, message.climb, message.alt])
    elif kind == "ATTITUDE":
        log.attitude.append([now, message.roll, message.pitch, message.yaw])
    elif message.port == 0:
        log.servo.append([now, *(getattr(message, f"servo{k}_raw") for k in range(1, 17))])


def _channels(parameters: Mapping[str, float]) -> dict[str, int]:
    channels: dict[str, int] = {}
    for channel in range(1, 17):
        for surface in _NAMES.get(int(parameters.get(f"SERVO{channel}_FUNCTION", 0)), ()):
            if surface not in channels:
                channels[surface] = channel
                break
    return channels


def _increasing(times: Array) -> NDArray[np.bool_]:
    """Return which samples are later than all earlier ones."""
    later = np.ones(times.size, dtype=np.bool_)
    later[1:] = times[1:] > np.maximum.accumulate(times)[:-1]
    return later


def _joined(at: Array, times: Array, values: Array, between: Between) -> Array:
    if between == "linear":
        return np.interp(at, times, values)
    held: Array = values[np.maximum(np.searchsorted(times, at, side="right") - 1, 0)]
    return held


def _sampled(at: Array, rows: list[list[float]], columns: int) -> Array:
    """Interpolate columns of (time, values…) rows; zeros where the log has none. Shape (columns, n)."""
    if not rows:
        return np.zeros((columns, at.size))
    table = np.array(rows, dtype=np.float64)
    table = table[_increasing(table[:, 0])]
    return np.stack([np.interp(at, table[:, 0], table[:, k + 1]) for k in range(columns)])
