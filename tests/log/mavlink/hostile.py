"""Mutated records with repaired CRCs, scanned whole and in blocks; what is found is accounted for."""

from __future__ import annotations

import random

from mavhums.log import Decoder
from mavhums.log.mavlink.dialect import load_dialect
from tests.log.mavlink.kernel_check import checked, scan
from tests.log.mavlink.synthetic import mutated, stream

POOL = 2000
PER_STREAM = 5000


def hostile_stream(rng: random.Random, pool: list[bytes], seeds: dict[int, int], mutations: int) -> bytes:
    """Mutated records, every third one followed by a sound one."""
    parts = []
    for _ in range(mutations):
        parts.append(mutated(rng, rng.choice(pool), seeds))
        if rng.random() < 0.33:
            parts.append(rng.choice(pool))
    return b"".join(parts)


def check(mutations: int, seed: int) -> tuple[int, int]:
    """Check on that many mutations; return the number of bytes and of frames found."""
    rng = random.Random(seed)
    pool = stream(seed, POOL)
    seeds = {number: d.crc_extra for number, d in load_dialect().definitions.items()}
    size = frames = 0
    for done in range(0, mutations, PER_STREAM):
        data = hostile_stream(rng, pool, seeds, min(PER_STREAM, mutations - done))
        found, _ = checked(data)
        frames += len(found)
        size += len(data)
        pieces, _ = scan(data, sorted(rng.randrange(len(data)) for _ in range(5)))
        assert pieces == found
        Decoder().feed(data, final=True)
    return size, frames
