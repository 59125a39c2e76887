"""Records mutated where it hurts, scanned whole and in blocks, held against the reference, and decoded."""

from __future__ import annotations

import random

from mavhums.log.dataflash import DataFlashDecoder
from tests.log.dataflash.kernel_check import checked, scan
from tests.log.dataflash.synthetic import mutated, stream

PER_STREAM = 2000


def hostile_stream(rng: random.Random, pool: list[bytes], mutations: int) -> bytes:
    """Definitions, then sound records and mutated ones."""
    parts = pool[:10]
    for _ in range(mutations):
        parts.append(mutated(rng, rng.choice(pool)))
        parts += [rng.choice(pool) for _ in range(rng.choice([0, 0, 1, 3]))]
    return b"".join(parts)


def check(mutations: int, seed: int) -> tuple[int, int]:
    """Compare on that many mutations; return the number of bytes and of records found."""
    rng = random.Random(seed)
    size = records = 0
    for done in range(0, mutations, PER_STREAM):
        pool = stream(rng.randrange(2**31), 500)
        data = hostile_stream(rng, pool, min(PER_STREAM, mutations - done))
        found, _ = checked(data)
        records += len(found)
        size += len(data)
        pieces, _ = scan(data, [rng.randrange(len(data)) for _ in range(5)])
        assert pieces == found
        decoder = DataFlashDecoder()
        for table in decoder.feed(data, final=True).values():
            table.to_frame()
    return size, records
