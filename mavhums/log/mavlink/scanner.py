"""Scanner that finds the MAVLink frames in a stream of bytes, and reports the unreadable parts.

A record is the u64 big-endian time of reception in microseconds of UTC, then a MAVLink 1 or 2
frame. Results do not depend on how the stream is divided into blocks: an unfinished record waits.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Bytes
from mavhums.log.base.scanner import Batch, BlockScanner
from mavhums.log.base.unaligned_io import GUARD, SPARE
from mavhums.log.mavlink.dialect import Dialect
from mavhums.log.mavlink.scan import ROW, STATE, scan

__all__ = ["FrameScanner"]

_LONGEST_RECORD = 8 + 10 + 255 + 2 + 13


class FrameScanner(BlockScanner):
    """Incremental scanner of blocks of any size.

    Parameters
    ----------
    dialect
        Dialect of the known messages.
    stamp
        Size of the time stamp before each frame, bytes: 8, or 0 for back-to-back frames.
    mend
        Whether frames with a bad CRC are checked again with the zeros that some senders trim.

    Attributes
    ----------
    bad_crc
        Number of frames in step with a bad CRC, by row of the dialect, shape (messages,).
    """

    def __init__(self, dialect: Dialect, *, stamp: int = 8, mend: bool = True) -> None:
        super().__init__(ROW, STATE, shortest=8 + stamp)
        self._ids, self._seeds, self._largest = _by_row(dialect)
        if not mend:
            self._largest = np.zeros_like(self._largest)
        self.bad_crc = np.zeros(self._seeds.size, dtype=np.int64)
        self._stamp = stamp
        self._scratch = np.zeros(GUARD + 265, dtype=np.uint8)
        self._carried["time_us"] = self._carried["sender"] = -1

    def feed(self, block: bytes, *, final: bool = False) -> Batch:
        """Return the frames that ``block`` completes; ``final`` marks the end of the stream."""
        joined = self._joined(block)
        data = np.frombuffer(joined, dtype=np.uint8)
        base = self.position
        found, ended = scan(
            data[: data.size - SPARE], self._stamp, final, self._carried, self._ids, self._seeds,
            self._largest, self.bad_crc, self._rows, self._damaged, self._scratch,
        )  # fmt: skip
        self._add_damage(self._damaged[:ended])
        position = int(self._carried["position"][0])
        self._carry(joined, position)
        self._carried["base"] += position - GUARD
        if final:
            self._finish(longest=_LONGEST_RECORD)
        return Batch(data, base, self._rows[:found], self._stamp)


@cache
def _by_row(dialect: Dialect) -> tuple[NDArray[np.int16], Bytes, NDArray[np.int32]]:
    """Return a dialect as arrays for the kernel: row by message id, then crc_extra and size by row."""
    definitions = dialect.definitions
    ids = np.full(max(definitions) + 1, -1, dtype=np.int16)
    ids[list(definitions)] = np.arange(len(definitions))
    seeds = np.array([d.crc_extra for d in definitions.values()], dtype=np.uint8)
    largest = np.array([d.wire.itemsize for d in definitions.values()], dtype=np.int32)
    return ids, seeds, largest
