"""Small simulated logs, several vehicles in one among them."""

from __future__ import annotations

import heapq
import struct
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim import Flight, fly, write_tlog


@cache
def small(
    seed: int = 1, friction_nm: float | None = None, *, surface: str = "elevator", seconds: float = 21.0
) -> bytes:
    """Return a log at 25 Hz; the friction of a surface is healthy unless it is given."""
    worn = {surface: (friction_nm, friction_nm)} if friction_nm else {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "small.tlog"
        write_tlog(fly(Flight(seed, seconds, worn, rate_hz=25.0, tiers=("instrumented",))), path)
        return path.read_bytes()


def records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield time and frame of each record of an undamaged log of MAVLink 2 frames."""
    place = 0
    while place < len(data):
        end = place + 8 + 12 + data[place + 9]
        yield struct.unpack_from(">Q", data, place)[0], data[place + 8 : end]
        place = end


def renamed(frame: bytes, system: int) -> bytes:
    """Return a frame as another system sends it."""
    body = frame[1:5] + bytes([system]) + frame[6:-2]
    extra = mavlink.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
    crc = mavlink.x25crc(body)
    crc.accumulate(bytes([extra]))
    return frame[:1] + body + struct.pack("<H", crc.crc)


def joined(*logs: bytes) -> bytes:
    """Return one log of several vehicles, with system ids from 1."""
    parts = [
        [(time, renamed(frame, system)) for time, frame in records(log)] for system, log in enumerate(logs, 1)
    ]
    return b"".join(struct.pack(">Q", time) + frame for time, frame in heapq.merge(*parts))


def moved(log: bytes, seconds: float) -> bytes:
    """Return a log that was received so much later."""
    by = round(seconds * 1e6)
    return b"".join(struct.pack(">Q", time + by) + frame for time, frame in records(log))


def nameless(log: bytes) -> bytes:
    """Return a log without the texts that name the board."""
    board = b"4D415648 "
    return b"".join(struct.pack(">Q", time) + frame for time, frame in records(log) if board not in frame)
