"""Count what is recovered of a damaged log, beside pymavlink.

A frame counts as undamaged if all its bytes are in the stream, unchanged and together. A frame that
is accepted counts as false if it is not one that was written, whatever its flags.
"""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mavhums.core.arrays import Integers
from mavhums.log.mavlink.dialect import load_dialect
from tests.log.damage import damage, damaged_bytes
from tests.log.mavlink.kernel_check import Frame, scan
from tests.log.mavlink.synthetic import stream

KINDS = ("flips", "outages", "insertions", "deletions")
SPACINGS = (100_000, 10_000, 1_000)


class Recovery(NamedTuple):
    """Frames of known messages: undamaged ones, those found of them, and accepted ones never written."""

    undamaged: int
    found: int
    false: int
    by_pymavlink: int
    written_frames_found: int


def recover(seed: int, count: int, kind: str, spacing: int) -> Recovery:
    """Damage a log and read what is left of it."""
    records, known = stream(seed, count), load_dialect().definitions
    whole = b"".join(records)
    origin = damage(whole, kind, max(1, len(whole) // spacing), seed)
    data = damaged_bytes(whole, origin)
    found = [frame for frame in scan(data)[0] if frame.id in known]
    starts = np.cumsum([0, *map(len, records)])[:-1] + 8
    by_start = dict(zip(starts.tolist(), records, strict=True))
    written = [_written(frame, origin, by_start) for frame in found]
    false = [frame for frame, true in zip(found, written, strict=True) if not true]
    intact = _undamaged(origin, by_start, known)
    of_intact = len(intact & {frame.offset + 8 for frame in found})
    certain = sum(not frame.padded for frame in false)
    return Recovery(len(intact), of_intact, certain, _by_pymavlink(data, records), sum(written))


def _undamaged(origin: Integers, by_start: dict[int, bytes], known: dict[int, Any]) -> set[int]:
    """Return where in the stream the undamaged frames of known messages begin."""
    out = set()
    for place in np.flatnonzero(np.isin(origin, list(by_start))).tolist():
        start = int(origin[place])
        frame = by_start[start][8:]
        same = np.array_equal(origin[place : place + len(frame)], np.arange(start, start + len(frame)))
        number = int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
        if same and number in known:
            out.add(place)
    return out


def _written(frame: Frame, origin: Integers, by_start: dict[int, bytes]) -> bool:
    """Whether a frame with this head and payload was written where its bytes come from."""
    record = by_start.get(int(origin[frame.offset + 8])) if frame.offset + 8 < origin.size else None
    if record is None:
        return False
    head = 10 if record[8] == 0xFD else 6
    payload = record[8 + head : 8 + head + record[9]]
    number = int.from_bytes(record[15:18], "little") if head == 10 else record[13]
    sequence = record[12] if head == 10 else record[10]
    return (number, sequence, payload) == (frame.id, frame.sequence, frame.payload)


def _by_pymavlink(data: bytes, records: list[bytes]) -> int:
    """Return how many written frames pymavlink finds."""
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavutil

    left = Counter(record[8 : 8 + (12 if record[8] == 0xFD else 8) + record[9]] for record in records)
    found: Counter[bytes] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.tlog"
        path.write_bytes(data)
        connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        while (message := connection.recv_msg()) is not None:
            if not message.get_type().startswith(("BAD_DATA", "UNKNOWN_")):
                buffer = bytes(message.get_msgbuf())
                found[buffer[: (12 if buffer[0] == 0xFD else 8) + buffer[1]]] += 1
        connection.close()
    return (found & left).total()
