"""Hold the kernel against the reference on records mutated where it hurts.

    NUMBA_BOUNDSCHECK=1 python -m tests.log.dataflash.hostile [--mutations 1000000] [--seed 1]

With NUMBA_BOUNDSCHECK=1 (and a NUMBA_CACHE_DIR of its own) every array access of the kernels is checked.
Each stream is scanned whole and in blocks, compared record by record with the reference, and decoded.
"""

from __future__ import annotations

import argparse
import random
import resource
import time

from mavhums.log.dataflash import DataFlashDecoder
from tests.log.dataflash.kernel_check import agree, scan
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
        found = agree(data)
        records += len(found)
        size += len(data)
        pieces, _ = scan(data, [rng.randrange(len(data)) for _ in range(5)])
        assert pieces == found
        decoder = DataFlashDecoder()
        for table in decoder.feed(data, final=True).values():
            table.to_frame()
    return size, records


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutations", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begin = time.perf_counter()
    size, records = check(options.mutations, options.seed)
    took = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{options.mutations:,} mutations, seed {options.seed}: {size / 1e6:.0f} MB, {records:,} records, "
        f"no difference; {took:.0f} s, peak memory {peak:.0f} MiB"
    )


if __name__ == "__main__":
    main()
