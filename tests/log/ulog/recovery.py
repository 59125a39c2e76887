"""Damage ULogs as cards and links do, and count what ours and pyulog get back.

A record is good if it is one of the sound log's, false if not.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from tests.log.damage import damage, damaged_bytes
from tests.log.decode import decode
from tests.log.ulog.peer import Columns, columns_of_ours, columns_of_peer

HEAD = 16
COUNTS = {
    "flips": 200,
    "cuts": 50,
    "long cuts": 50,
    "zeroed sectors": 25,
    "random sectors": 25,
    "cut at 60 %": 0,
}


def damaged(log: bytes, name: str, seed: int) -> bytes:
    """Return a log whose header alone is sound; of a name without a count, its first 60 %."""
    if name not in COUNTS:
        return log[: len(log) * 6 // 10]
    return log[:HEAD] + damaged_bytes(log[HEAD:], damage(log[HEAD:], name, COUNTS[name], seed))


def records(columns: Columns) -> Counter[bytes]:
    """Return the records, topic and multi id before their values, without names."""
    out: Counter[bytes] = Counter()
    for (name, instance), by_field in columns.items():
        parts = [np.ascontiguousarray(v).view(np.uint8).reshape(len(v), -1) for v in by_field.values()]
        rows = np.concatenate(parts, axis=1)
        head = f"{name}/{instance}/".encode()
        out.update(head + row.tobytes() for row in rows)
    return out


def score(found: Counter[bytes], sound: Counter[bytes]) -> tuple[int, int]:
    """Return how many records are good and how many false."""
    good = (found & sound).total()
    return good, found.total() - good


def ours(log: bytes) -> Counter[bytes]:
    return records(columns_of_ours(decode(log)[0], both=False))


def theirs(log: bytes) -> Counter[bytes]:
    try:
        return records(columns_of_peer(log))
    except Exception:
        return Counter()
