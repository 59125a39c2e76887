"""Writer of the telemetry log: MAVLink 2 messages in a ``.tlog``, written with pymavlink.

Record of a ``.tlog``: u64 big-endian microseconds of UTC at reception, then the frame.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim._arrays import Array
from mavhums_sim._files import written_whole
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.flight import ActuatorRecord, Flight, FlightRecord
from mavhums_sim.link import BOOT_US, Frame, Link, transmit
from mavhums_sim.sensors import ELECTRONICS_A, sample_times
from mavhums_sim.tiers import Stream, actuator_streams

BOARD = "SimBoard 4D415648 554D5353 494D0001"
"""Type and unique id of the autopilot's board in an aircraft whose actuators are the data sheet's."""

_FUNCTIONS = {"aileron_left": 4, "aileron_right": 4, "elevator": 19, "rudder": 21}

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


def board(flight: Flight) -> str:
    """Return type and unique id of the autopilot's board, which every individual aircraft has of its own.

    Examples
    --------
    >>> board(Flight()) == BOARD, board(Flight(individuals=7))
    (True, 'SimBoard 4D415648 554D5353 494E0007')
    """
    return (
        BOARD
        if flight.individuals is None
        else f"{BOARD[:-8]}{(0x494E0000 + flight.individuals) % 2**32:08X}"
    )


def messages(record: FlightRecord) -> Iterator[tuple[float, Message]]:
    """Yield (flight time in s, message) in the order in which the aircraft sends them."""
    return in_order(_streams(record))


def in_order(streams: list[Stream]) -> Iterator[tuple[float, Message]]:
    """Yield (time in s, message) of all streams in the order of their times."""
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
    return write_frames(transmit(messages(record), link or Link(), record.flight.seed), path)


def write_frames(frames: Iterable[Frame], path: Path) -> dict[str, int]:
    """Write received frames as a ``.tlog``, atomically, and return the number of messages by type."""
    counts: dict[str, int] = {}
    with written_whole(path) as temporary, temporary.open("wb") as file:
        for frame in frames:
            file.write(struct.pack(">Q", frame.received_us) + frame.data)
            counts[frame.name] = counts.get(frame.name, 0) + 1
    return counts


def _streams(record: FlightRecord) -> list[Stream]:
    flight = record.flight
    rng = np.random.default_rng([flight.seed, 4])

    def at(rate_hz: float) -> Array:
        return sample_times(rng, flight.duration_s, rate_hz)

    announced = np.arange(0.0, flight.duration_s, 10.0, dtype=np.float64)
    told = parameters()
    streams = [
        Stream(np.arange(0.0, flight.duration_s, 1.0, dtype=np.float64), lambda _: _heartbeat()),
        Stream(announced, lambda _: mavlink.MAVLink_statustext_message(6, b"mavhums airframe=paper")),
        Stream(np.full(1, 0.1), lambda _: mavlink.MAVLink_statustext_message(6, board(flight).encode())),
        Stream(
            0.2 + 0.005 * np.arange(len(told), dtype=np.float64),
            lambda k: mavlink.MAVLink_param_value_message(told[k][0].encode(), told[k][1], 9, len(told), k),
        ),
        _aircraft_state(record, at(flight.rates.attitude)),
        _air_data(record, at(flight.rates.air_data)),
        battery(flight, record.actuators, at(flight.rates.battery)),
    ]
    return streams + actuator_streams(record)


def _heartbeat() -> Message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 209, 10, 4, 3
    )


def parameters() -> list[tuple[str, float]]:
    """Return the autopilot's parameters that the aircraft reports."""
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


def _aircraft_state(record: FlightRecord, times: Array) -> Stream:
    flown = record.cyclogram
    angles = [np.interp(times, flown.time_s, signal) for signal in (flown.roll, flown.pitch, flown.yaw)]
    rates = [_rate_of_change(signal, times) for signal in angles]
    return Stream(
        times,
        lambda k: mavlink.MAVLink_attitude_message(
            _boot_ms(times[k]), *(float(a[k]) for a in angles), *(float(r[k]) for r in rates)
        ),
    )


def _air_data(record: FlightRecord, times: Array) -> Stream:
    flown = record.cyclogram
    airspeed = np.interp(times, flown.time_s, flown.airspeed)
    altitude = np.interp(times, flown.time_s, flown.altitude)
    climb = _rate_of_change(altitude, times)
    heading = np.degrees(np.interp(times, flown.time_s, flown.yaw)) % 360
    return Stream(
        times,
        lambda k: mavlink.MAVLink_vfr_hud_message(
            float(airspeed[k]), float(airspeed[k]), int(heading[k]), 60, float(altitude[k]), float(climb[k])
        ),
    )


def battery(flight: Flight, actuators: Mapping[str, ActuatorRecord], times: Array) -> Stream:
    """Return BATTERY_STATUS of the actuators' supply at the times."""
    motions = [actuator.motion for actuator in actuators.values()]
    shared_sag = np.min([motion.degradation.sag for motion in motions], axis=0)
    volts = flight.parameters.supply_voltage - np.interp(times, motions[0].time_s, shared_sag)
    watts = sum(np.interp(times, motion.time_s, motion.voltage * motion.current) for motion in motions)
    current = np.asarray(watts) / volts + ELECTRONICS_A * len(motions)
    millivolts = np.rint(volts * 1000).astype(int)
    return Stream(
        times,
        lambda k: mavlink.MAVLink_battery_status_message(
            0, 0, 1, 32767, [int(millivolts[k]), *[65535] * 9], round(float(current[k]) * 100), -1, -1, 80
        ),
    )
