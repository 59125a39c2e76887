"""Hold the decoder's kernel against the reference on records mutated with repaired CRCs.

    NUMBA_BOUNDSCHECK=1 python -m tests.log.mavlink.hostile [--mutations 10000000] [--seed 1]

With NUMBA_BOUNDSCHECK=1 (and a NUMBA_CACHE_DIR of its own) every array access of the kernel is
checked. Each stream is scanned whole and in blocks, and compared frame by frame with the reference.
"""

from __future__ import annotations

import argparse
import random
import resource
import time

from mavhums.log import Decoder
from mavhums.log.mavlink.dialect import load_dialect
from tests.log.mavlink.kernel_check import agree, scan
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
    """Compare on that many mutations; return the number of bytes and of frames found."""
    rng = random.Random(seed)
    pool = stream(seed, POOL)
    seeds = {number: d.crc_extra for number, d in load_dialect().definitions.items()}
    size = frames = 0
    for done in range(0, mutations, PER_STREAM):
        data = hostile_stream(rng, pool, seeds, min(PER_STREAM, mutations - done))
        found = agree(data)
        frames += len(found.frames)
        size += len(data)
        pieces, _ = scan(data, sorted(rng.randrange(len(data)) for _ in range(5)))
        assert pieces == found.frames
        Decoder().feed(data, final=True)
    return size, frames


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutations", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begin = time.perf_counter()
    size, frames = check(options.mutations, options.seed)
    took = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{options.mutations:,} mutations, seed {options.seed}: {size / 1e6:.0f} MB, {frames:,} frames, "
        f"no difference; {took:.0f} s, peak memory {peak:.0f} MiB"
    )


if __name__ == "__main__":
    main()
