"""Damage a log as cards and links do, and know where each byte of what is left comes from."""

from __future__ import annotations

import numpy as np

from mavhums.core.arrays import Integers

LENGTHS = {"cuts": (1, 64), "long cuts": (64, 600), "deletions": (1, 100), "outages": (1, 4000)}
SECTORS = {"zeroed sectors": 512, "zeroed blocks": 200, "random sectors": 512, "old clusters": 4096}
KINDS = ("flips", "insertions", *LENGTHS, *SECTORS)


def damage(data: bytes, kind: str, count: int, seed: int) -> Integers:
    """Return where each byte of the damaged log comes from; the negative ones come from nowhere.

    -2 … -257 mean the byte values 0…255 that were put there; a flipped bit is such a byte.
    """
    rng = np.random.default_rng(seed)
    origin = np.arange(len(data))
    if kind in SECTORS:
        size = SECTORS[kind]
        for block in rng.choice(np.arange(4, len(data) // size), count, replace=False).tolist():
            place = slice(block * size, (block + 1) * size)
            if kind == "old clusters":
                origin[place] = origin[(block - 3) * size : (block - 2) * size]
            else:
                origin[place] = -2 - (rng.integers(0, 256, size) if kind == "random sectors" else 0)
        return origin
    low, high = LENGTHS.get(kind, (1, 100))
    places = rng.choice(len(data) - high, count, replace=False)
    if kind == "flips":
        old = np.frombuffer(data, dtype=np.uint8)[places].astype(np.int64)
        origin[places] = -2 - (old ^ (1 << rng.integers(0, 8, count)))
        return origin
    lengths = rng.integers(low, high + 1, count)
    if kind == "insertions":
        return np.insert(origin, np.repeat(places, lengths), -2 - rng.integers(0, 256, lengths.sum()))
    keep = np.ones(len(data), dtype=bool)
    for place, length in zip(places.tolist(), lengths.tolist(), strict=True):
        keep[place : place + length] = False
    return origin[keep]


def damaged_bytes(data: bytes, origin: Integers) -> bytes:
    """The damaged log itself."""
    put = -2 - origin
    return np.where(origin >= 0, np.frombuffer(data, dtype=np.uint8)[origin], put).astype(np.uint8).tobytes()
