"""Writes the log of a closed-loop flight: the vehicle's messages, and the EMAs' telemetry if present."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim.closed_loop.flight import FlownLoop
from mavhums_sim.closed_loop.reports import Streams, report
from mavhums_sim.flight import FlightRecord
from mavhums_sim.link import Link, transmit
from mavhums_sim.sensors import sample_times
from mavhums_sim.telemetry import battery, in_order, write_frames
from mavhums_sim.tiers import Stream, actuator_streams


def loop_messages(flown: FlownLoop, streams: Streams | None = None) -> Iterator[tuple[float, Any]]:
    """Yield (time in s, message) of a flight in sending order."""
    parts = [table.stream() for table in report(flown, streams)]
    if flown.emas is not None:
        parts += _ema_streams(flown.emas)
    return in_order(parts)


def write_loop(
    flown: FlownLoop, path: Path, streams: Streams | None = None, link: Link | None = None
) -> dict[str, int]:
    """Write the flight's ``.tlog`` atomically and return the number of messages by type.

    Raises
    ------
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    frames = transmit(loop_messages(flown, streams), link or Link(), flown.flight.seed)
    return write_frames(frames, path)


def _ema_streams(record: FlightRecord) -> list[Stream]:
    """Return the tiers in addition to SERVO_OUTPUT_RAW, the supply, and the profile's name."""
    flight = record.flight
    others = replace(
        record, flight=replace(flight, tiers=tuple(tier for tier in flight.tiers if tier != "pwm"))
    )
    times = sample_times(np.random.default_rng([flight.seed, 32]), flight.duration_s, flight.rates.battery)
    announced = np.arange(0.0, flight.duration_s, 10.0, dtype=np.float64)
    named = Stream(announced, lambda _: mavlink.MAVLink_statustext_message(6, b"mavhums airframe=paper"))
    return [*actuator_streams(others), battery(flight, record.actuators, times), named]
