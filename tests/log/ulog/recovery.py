"""Damage ULogs as cards and links do, and count what ours and pyulog get back.

A record is good if it is one of the sound log's, false if not.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable

import numpy as np

from tests.log.decode import decode
from tests.log.ulog.peer import Columns, columns_of_ours, columns_of_peer

HEAD = 16
Damage = Callable[[random.Random, bytes], bytes]


def flips(rng: random.Random, log: bytes, count: int = 200) -> bytes:
    out = bytearray(log)
    for _ in range(count):
        out[rng.randrange(HEAD, len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def cuts(rng: random.Random, log: bytes, least: int, most: int, count: int = 50) -> bytes:
    out = bytearray(log)
    for place in sorted((rng.randrange(HEAD, len(log) - most) for _ in range(count)), reverse=True):
        del out[place : place + rng.randint(least, most)]
    return bytes(out)


def sectors(rng: random.Random, log: bytes, noise: bool, count: int = 25) -> bytes:
    out = bytearray(log)
    for _ in range(count):
        begin = rng.randrange(HEAD, len(log) - 512) // 512 * 512 + 512
        if begin + 512 <= len(log):
            out[begin : begin + 512] = rng.randbytes(512) if noise else bytes(512)
    return bytes(out)


DAMAGE: dict[str, Damage] = {
    "200 bit flips": flips,
    "50 cuts of 1–64 B": lambda rng, log: cuts(rng, log, 1, 64),
    "50 cuts of 64–600 B": lambda rng, log: cuts(rng, log, 64, 600),
    "25 zeroed sectors": lambda rng, log: sectors(rng, log, noise=False),
    "25 random sectors": lambda rng, log: sectors(rng, log, noise=True),
    "cut at 60 %": lambda _, log: log[: len(log) * 6 // 10],
}


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
