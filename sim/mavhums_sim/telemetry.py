"""The log that the flight leaves: MAVLink 2 messages in a ``.tlog``, written with pymavlink.

Record of a ``.tlog``: u64 big-endian microseconds of UTC at reception, then the frame.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.flight import FlightRecord
from mavhums_sim.link import BOOT_US, EPOCH_US, Link, transmit
from mavhums_sim.sensors import ELECTRONICS_A, sample_times

__all__ = ["EPOCH_US", "MESSAGES", "messages", "write_tlog"]

_FUNCTIONS = {"aileron_left": 4, "aileron_right": 4, "elevator": 19, "rudder": 21}
_PWM_TRIM, _PWM_PER_DEGREE = 1500.0, 500.0 / 60.0

Array = NDArray[np.float64]
Message = Any

MESSAGES = (
    "HEARTBEAT",
    "STATUSTEXT",
    "PARAM_VALUE",
    "ATTITUDE",
    "VFR_HUD",
    "BATTERY_STATUS",
    "SERVO_OUTPUT_RAW",
    "ESC_TELEMETRY_1_TO_4",
    "DEBUG_FLOAT_ARRAY",
)


@dataclass(frozen=True, slots=True)
class _Stream:
    """One message type: when it is sent and how its k-th message is built."""

    times: Array
    build: Callable[[int], Message]


def messages(record: FlightRecord) -> Iterator[tuple[float, Message]]:
    """Yield (flight time in s, message) in the order in which the aircraft sends them."""
    streams = _streams(record)
    times = np.concatenate([stream.times for stream in streams])
    owner = np.repeat(np.arange(len(streams)), [stream.times.size for stream in streams])
    index = np.concatenate([np.arange(stream.times.size) for stream in streams])
    for k in np.argsort(times, kind="stable"):
        yield float(times[k]), streams[owner[k]].build(int(index[k]))


def write_tlog(record: FlightRecord, path: Path, link: Link | None = None) -> dict[str, int]:
    """Write the flight's ``.tlog`` atomically and return the number of messages by type.

    Parameters
    ----------
    link
        Between aircraft and log; loses and reorders nothing if omitted.

    Raises
    ------
    OSError
        If the file cannot be written; what was at ``path`` before is then still there.
    """
    counts: dict[str, int] = {}
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            for frame in transmit(messages(record), link or Link(), record.flight.seed):
                file.write(struct.pack(">Q", frame.received_us) + frame.data)
                counts[frame.name] = counts.get(frame.name, 0) + 1
        os.replace(partial, path)  # noqa: PTH105 - atomic, and says so
    finally:
        partial.unlink(missing_ok=True)
    return counts


def _streams(record: FlightRecord) -> list[_Stream]:
    flight = record.flight
    rng = np.random.default_rng([flight.seed, 4])

    def at(rate_hz: float) -> Array:
        return sample_times(rng, flight.duration_s, rate_hz)

    announced = np.arange(0.0, flight.duration_s, 10.0, dtype=np.float64)
    parameters = _parameters()
    streams = [
        _Stream(np.arange(0.0, flight.duration_s, 1.0, dtype=np.float64), lambda _: _heartbeat()),
        _Stream(announced, lambda _: mavlink.MAVLink_statustext_message(6, b"mavhums airframe=paper")),
        _Stream(
            0.2 + 0.005 * np.arange(len(parameters), dtype=np.float64),
            lambda k: mavlink.MAVLink_param_value_message(
                parameters[k][0].encode(), parameters[k][1], 9, len(parameters), k
            ),
        ),
        _aircraft_state(record, at(flight.rates.attitude)),
        _air_data(record, at(flight.rates.air_data)),
        _battery(record, at(flight.rates.battery)),
        _servo_outputs(record, at(flight.rates.servo_output)),
        _esc_telemetry(record, at(flight.rates.esc)),
    ]
    streams += [_instrumented(record, surface) for surface in SURFACES]
    return streams


def _heartbeat() -> Message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 209, 10, 4, 3
    )


def _parameters() -> list[tuple[str, float]]:
    rows = []
    for servo, surface in enumerate(SURFACES, start=1):
        for key, value in (
            ("FUNCTION", _FUNCTIONS[surface]),
            ("MIN", 1000),
            ("TRIM", 1500),
            ("MAX", 2000),
            ("REVERSED", 0),
        ):
            rows.append((f"SERVO{servo}_{key}", float(value)))
    return rows


def _boot_ms(time_s: float) -> int:
    return (BOOT_US + round(time_s * 1e6)) // 1000


def _rate_of_change(signal: Array, times: Array) -> Array:
    return np.gradient(signal, times) if times.size > 1 else np.zeros_like(times)


def _aircraft_state(record: FlightRecord, times: Array) -> _Stream:
    flown = record.cyclogram
    angles = [np.interp(times, flown.time_s, signal) for signal in (flown.roll, flown.pitch, flown.yaw)]
    rates = [_rate_of_change(signal, times) for signal in angles]
    return _Stream(
        times,
        lambda k: mavlink.MAVLink_attitude_message(
            _boot_ms(times[k]), *(float(a[k]) for a in angles), *(float(r[k]) for r in rates)
        ),
    )


def _air_data(record: FlightRecord, times: Array) -> _Stream:
    flown = record.cyclogram
    airspeed = np.interp(times, flown.time_s, flown.airspeed)
    altitude = np.interp(times, flown.time_s, flown.altitude)
    climb = _rate_of_change(altitude, times)
    heading = np.degrees(np.interp(times, flown.time_s, flown.yaw)) % 360
    return _Stream(
        times,
        lambda k: mavlink.MAVLink_vfr_hud_message(
            float(airspeed[k]), float(airspeed[k]), int(heading[k]), 60, float(altitude[k]), float(climb[k])
        ),
    )


def _battery(record: FlightRecord, times: Array) -> _Stream:
    shared_sag = np.min([a.motion.degradation.sag for a in record.actuators.values()], axis=0)
    sag = np.interp(times, record.cyclogram.time_s, shared_sag)
    volts = record.flight.parameters.supply_voltage - sag
    watts = sum(
        np.interp(times, a.motion.time_s, a.motion.voltage * a.motion.current)
        for a in record.actuators.values()
    )
    current = np.asarray(watts) / volts + ELECTRONICS_A * len(record.actuators)
    millivolts = np.rint(volts * 1000).astype(int)
    return _Stream(
        times,
        lambda k: mavlink.MAVLink_battery_status_message(
            0, 0, 1, 32767, [int(millivolts[k]), *[65535] * 9], round(float(current[k]) * 100), -1, -1, 80
        ),
    )


def _servo_outputs(record: FlightRecord, times: Array) -> _Stream:
    pulses = np.stack(
        [
            np.interp(times, a.motion.time_s, np.degrees(a.motion.command)) * _PWM_PER_DEGREE + _PWM_TRIM
            for a in record.actuators.values()
        ],
        axis=1,
    )
    return _Stream(
        times,
        lambda k: mavlink.MAVLink_servo_output_raw_message(
            (BOOT_US + round(times[k] * 1e6)) % 2**32, 0, *(round(float(p)) for p in pulses[k]), *[0] * 12
        ),
    )


def _esc_telemetry(record: FlightRecord, times: Array) -> _Stream:
    def read(column: int, scale: float) -> NDArray[np.int64]:
        signals = [np.interp(times, a.time_s, np.abs(a.esc[:, column])) for a in record.actuators.values()]
        return np.clip(np.rint(np.stack(signals, axis=1) * scale), 0, 65535).astype(np.int64)

    centivolts, centiamperes, speed = read(0, 100.0), read(1, 100.0), read(2, 1.0)
    return _Stream(
        times,
        lambda k: mavlink.MAVLink_esc_telemetry_1_to_4_message(
            [35] * 4,
            centivolts[k].tolist(),
            centiamperes[k].tolist(),
            [0] * 4,
            speed[k].tolist(),
            [k % 65536] * 4,
        ),
    )


def _instrumented(record: FlightRecord, surface: str) -> _Stream:
    actuator = record.actuators[surface]
    servo = SURFACES.index(surface) + 1
    spare = [0.0] * 46
    return _Stream(
        actuator.time_s,
        lambda k: mavlink.MAVLink_debug_float_array_message(
            BOOT_US + round(actuator.time_s[k] * 1e6), b"EMA", servo, actuator.values[k].tolist() + spare
        ),
    )
