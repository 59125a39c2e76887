"""Count what is recovered of a damaged DataFlash log, beside pymavlink.

A record counts as good if all its bytes are in the stream, unchanged and together; one that is accepted
and is not good counts as false. A record of an old cluster is false: it is in the log a second time. For
pymavlink, ``trusting`` is what DFReader's sequential reading accepts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Integers
from tests.log.damage import damage, damaged_bytes
from tests.log.dataflash.kernel_check import scan

COUNTS = {
    "flips": 400, "cuts": 200, "long cuts": 200, "zeroed sectors": 50, "zeroed blocks": 100,
    "random sectors": 50, "old clusters": 10,
}  # fmt: skip


class Recovery(NamedTuple):
    """Records: intact ones in the stream, then good and false ones of each reader."""

    intact: int
    good: int
    false: int
    trusting: tuple[int, int]


def recover(data: bytes, kind: str, count: int, seed: int) -> Recovery:
    """Damage a log and read what is left of it."""
    origin = damage(data, kind, count, seed)
    damaged = damaged_bytes(data, origin)
    starts = {record.offset: len(record.payload) + 3 for record in scan(data)[0]}
    intact = {
        place
        for place in np.flatnonzero(np.isin(origin, list(starts))).tolist()
        if _together(origin, place, starts[int(origin[place])])
        and (kind != "old clusters" or origin[place] == place)
    }
    found = {record.offset for record in scan(damaged)[0]}
    trusted = set(_trusting(damaged))
    trusting = (len(trusted & intact), len(trusted - intact))
    return Recovery(len(intact), len(found & intact), len(found - intact), trusting)


def _together(origin: Integers, place: int, size: int) -> bool:
    start = int(origin[place])
    return np.array_equal(origin[place : place + size], np.arange(start, start + size))


def _trusting(data: bytes) -> Iterator[int]:
    """Yield the offsets that DFReader's sequential reading accepts: it trusts every length."""
    lengths = {128: 89}
    place = 0
    while place + 3 <= len(data):
        length = lengths.get(data[place + 2], 0)
        if data[place : place + 2] != b"\xa3\x95" or length == 0 or place + length > len(data):
            place += 1
            continue
        if data[place + 2] == 128:
            lengths[data[place + 3]] = data[place + 4]
        yield place
        place += length
