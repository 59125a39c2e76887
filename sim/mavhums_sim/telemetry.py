"""Writer of the telemetry log: MAVLink 2 messages in a ``.tlog``, written with pymavlink.

Record of a ``.tlog``: u64 big-endian microseconds of UTC at reception, then the frame.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim._arrays import Array
from mavhums_sim._files import written_whole
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.flight import ActuatorRecord, Flight, FlightRecord
from mavhums_sim.link import BOOT_US, Frame, Link, frame_size, transmit
from mavhums_sim.sensors import ELECTRONICS_A, sample_times
from mavhums_sim.tiers import Stream, actuator_streams

BOARD = "SimBoard 4D415648 554D5353 494D0001"
"""Type and unique id of the autopilot's board in an aircraft whose actuators are the data sheet's."""

_FUNCTIONS = {"aileron_left": 4, "aileron_right": 4, "elevator": 19, "rudder": 21}

_WHOLE = 4
"""So many of the streams come first, and whole, over a link that is too slow for all."""
_BITS_PER_BYTE = 10  # of a serial line: start, eight, stop
_HOME_DEG, _HOME_M, _METRES_PER_DEGREE = (47.0, 8.0), 400.0, 111_320.0

Message = Any

MESSAGES = (
    "HEARTBEAT",
    "STATUSTEXT",
    "PARAM_VALUE",
    "ATTITUDE",
    "VFR_HUD",
    "BATTERY_STATUS",
    "GPS_RAW_INT",
    "SYS_STATUS",
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


def messages(record: FlightRecord, link: Link | None = None) -> Iterator[tuple[float, Message]]:
    """Yield (flight time in s, message) in the order in which the aircraft sends them.

    Of a link that is too slow for all of them, heartbeats, texts and parameters take what they need; every
    other stream is thinned in the same proportion, as an autopilot slows its streams down.
    """
    streams = _streams(record)
    if link is None or link.baud is None:
        return in_order(streams)
    duration_s, taken, wanted = record.flight.duration_s, 0.0, 0.0
    for number, stream in enumerate(streams):
        size = max((frame_size(link, stream.build(k)) for k in _some(stream)), default=0)
        if number < _WHOLE:
            taken += size * max(np.bincount(stream.times.astype(np.intp)), default=0)
        else:
            wanted += size * stream.times.size / duration_s
    share = (link.baud / _BITS_PER_BYTE - taken) / wanted if wanted else 1.0
    if share <= 0.0:
        raise ValueError(f"{link.baud:g} baud do not carry heartbeats and parameters")
    others = streams[_WHOLE:]
    slowed = [thinned(stream, share, k / len(others)) for k, stream in enumerate(others)]
    return in_order([*streams[:_WHOLE], *slowed])


def _some(stream: Stream) -> list[int]:
    """Return some messages of a stream; a size depends on the zeros at the end."""
    return (
        np.unique(np.linspace(0, stream.times.size - 1, 9).astype(int)).tolist() if stream.times.size else []
    )


def thinned(stream: Stream, share: float, phase: float = 0.0) -> Stream:
    """Return a stream with a share of its samples, evenly spaced; all of them if the share is 1 or more.

    The phase, from 0 to below 1, says which: streams of different phases do not come in bursts.
    """
    if share >= 1.0:
        return stream
    samples = stream.times.size // stream.together
    kept = np.floor(np.arange(phase / share, samples, 1.0 / share)).astype(np.intp)
    rows = (kept[:, None] * stream.together + np.arange(stream.together)).ravel()
    return Stream(stream.times[rows], lambda k: stream.build(int(rows[k])), stream.together)


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
    link = link or Link()
    return write_frames(transmit(messages(record, link), link, record.flight.seed), path)


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
    rows = parameters()
    streams = [
        Stream(np.arange(0.0, flight.duration_s, 1.0, dtype=np.float64), lambda _: _heartbeat()),
        Stream(announced, lambda _: mavlink.MAVLink_statustext_message(6, b"mavhums airframe=paper")),
        Stream(np.full(1, 0.1), lambda _: mavlink.MAVLink_statustext_message(6, board(flight).encode())),
        Stream(
            0.2 + 0.005 * np.arange(len(rows), dtype=np.float64),
            lambda k: mavlink.MAVLink_param_value_message(rows[k][0].encode(), rows[k][1], 9, len(rows), k),
        ),
        _aircraft_state(record, at(flight.rates.attitude)),
        _air_data(record, at(flight.rates.air_data)),
        battery(flight, record.actuators, at(flight.rates.battery)),
        _gps(record, at(flight.rates.gps)),
        _status(record, at(flight.rates.status)),
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


def _gps(record: FlightRecord, times: Array) -> Stream:
    """Return fixes of an aircraft that flies through still air along its heading."""
    flown = record.cyclogram
    period = np.diff(flown.time_s, prepend=0.0)
    speed = flown.airspeed * np.cos(flown.pitch)
    north, east = (
        np.interp(times, flown.time_s, np.cumsum(speed * way(flown.yaw) * period)) for way in (np.cos, np.sin)
    )
    altitude, ground, course = (
        np.interp(times, flown.time_s, signal) for signal in (flown.altitude, speed, np.degrees(flown.yaw))
    )
    latitude = _HOME_DEG[0] + north / _METRES_PER_DEGREE
    longitude = _HOME_DEG[1] + east / (_METRES_PER_DEGREE * np.cos(np.radians(_HOME_DEG[0])))
    columns = (latitude * 1e7, longitude * 1e7, 1000.0 * (_HOME_M + altitude))
    rows = np.rint(np.stack([*columns, 100.0 * ground, 100.0 * (course % 360.0)], axis=1)).astype(int)

    def build(k: int) -> Message:
        latitude, longitude, height, speed, course = rows[k].tolist()
        return mavlink.MAVLink_gps_raw_int_message(
            BOOT_US + round(times[k] * 1e6),
            3,
            latitude,
            longitude,
            height,
            80,
            120,
            speed,
            course % 36000,
            14,
        )

    return Stream(times, build)


def _status(record: FlightRecord, times: Array) -> Stream:
    millivolts, current = _supply(record.flight, record.actuators, times)
    sensors = ("GPS", "3D_GYRO", "DIFFERENTIAL_PRESSURE")
    healthy = [sum(getattr(mavlink, f"MAV_SYS_STATUS_SENSOR_{name}") for name in sensors)] * 3
    return Stream(
        times,
        lambda k: mavlink.MAVLink_sys_status_message(
            *healthy, 300, int(millivolts[k]), round(float(current[k]) * 100), 80, 0, 0, 0, 0, 0, 0
        ),
    )


def _supply(
    flight: Flight, actuators: Mapping[str, ActuatorRecord], times: Array
) -> tuple[NDArray[np.int_], Array]:
    """Return voltage, mV, and current, A, of the actuators' supply."""
    motions = [actuator.motion for actuator in actuators.values()]
    shared_sag = np.min([motion.degradation.sag for motion in motions], axis=0)
    volts = flight.parameters.supply_voltage - np.interp(times, motions[0].time_s, shared_sag)
    watts = sum(np.interp(times, motion.time_s, motion.voltage * motion.current) for motion in motions)
    current = np.asarray(watts) / volts + ELECTRONICS_A * len(motions)
    return np.rint(volts * 1000).astype(int), current


def battery(flight: Flight, actuators: Mapping[str, ActuatorRecord], times: Array) -> Stream:
    """Return BATTERY_STATUS of the actuators' supply at the times."""
    millivolts, current = _supply(flight, actuators, times)
    return Stream(
        times,
        lambda k: mavlink.MAVLink_battery_status_message(
            0, 0, 1, 32767, [int(millivolts[k]), *[65535] * 9], round(float(current[k]) * 100), -1, -1, 80
        ),
    )
