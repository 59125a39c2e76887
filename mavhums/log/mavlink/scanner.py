"""Scanner that finds the MAVLink frames in a stream of bytes, and reports the unreadable parts.

A record is the u64 big-endian time of reception in microseconds of UTC, then a MAVLink 1 or 2
frame. Results do not depend on how the stream is divided into blocks: an unfinished record waits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log.mavlink import _kernel
from mavhums.log.mavlink.dialect import Dialect
from mavhums.log.words import GUARD

__all__ = ["Batch", "FrameScanner", "Totals"]

_LONGEST_RECORD = 8 + 10 + 255 + 2 + 13
_ZERO_RUN = 16
_REGIONS_KEPT = 1000


class Totals(NamedTuple):
    """Counts of a scan so far; bytes and frames.

    ``skipped`` and ``regions`` are damage between frames, ``cut_end`` an unfinished last record,
    ``zeros`` zero bytes after the last frame.
    """

    skipped: int
    regions: int
    cut_end: int
    zeros: int
    odd_times: int
    jumps: int
    rewinds: int
    padded: int
    trials: int


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """The frames that a block completed, as ``_kernel.ROW``, and the scanned buffer."""

    data: NDArray[np.uint8]
    base: int
    stamp: int
    rows: NDArray[np.void]


class FrameScanner:
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
    regions
        Offset and size of the first thousand damaged regions.
    """

    def __init__(self, dialect: Dialect, *, stamp: int = 8, mend: bool = True) -> None:
        self._ids, self._seeds, self._largest = _by_row(dialect)
        if not mend:
            self._largest = np.zeros_like(self._largest)
        self.bad_crc = np.zeros(self._seeds.size, dtype=np.int64)
        self.regions: list[tuple[int, int]] = []
        self._stamp = stamp
        self._scratch = np.zeros(GUARD + 265, dtype=np.uint8)
        self._rows = np.empty(0, dtype=_kernel.ROW)
        self._carried = np.zeros(1, dtype=_kernel.STATE)
        self._carried["time_us"] = self._carried["sender"] = -1
        self._rest = bytes(GUARD)
        self._skipped = self._count = 0
        self._final = False

    def feed(self, block: bytes, *, final: bool = False) -> Batch:
        """Return the frames that ``block`` completes; ``final`` marks the end of the stream."""
        joined = self._rest + block
        data = np.frombuffer(joined, dtype=np.uint8)
        most = (data.size - GUARD) // (8 + self._stamp) + 1
        if self._rows.size < most:
            self._rows = np.empty(most, dtype=_kernel.ROW)
        regions = np.empty(most + 1, dtype=_kernel.REGION)
        base = int(self._carried["base"][0])
        found, ended = _kernel.scan(
            data,
            self._stamp,
            final,
            self._carried,
            self._ids,
            self._seeds,
            self._largest,
            self.bad_crc,
            self._rows,
            regions,
            self._scratch,
        )
        self._keep(regions[:ended])
        position = int(self._carried["position"][0])
        self._rest = joined[position - GUARD :]
        self._carried["base"] += position - GUARD
        if final:
            self._finish()
        return Batch(data, base, self._stamp, self._rows[:found])

    @property
    def totals(self) -> Totals:
        """Counts of skipped bytes and irregular frames so far."""
        state = self._carried[0]
        waiting = int(state["skipped"])
        zeros, cut = (int(state["zeros"]), 0) if self._final else (0, 0)
        if self._final:
            zeros = zeros if zeros >= _ZERO_RUN else 0
            cut = waiting - zeros
            waiting = 0
        return Totals(
            self._skipped + waiting,
            self._count + bool(waiting),
            cut,
            zeros,
            *(int(state[name]) for name in ("odd_times", "jumps", "rewinds", "padded", "trials")),
        )

    def _keep(self, regions: NDArray[np.void]) -> None:
        self._skipped += int(regions["size"].sum())
        self._count += regions.size
        room = _REGIONS_KEPT - len(self.regions)
        self.regions += [(int(offset), int(size)) for offset, size in regions[:room]]

    def _finish(self) -> None:
        """Classify the bytes after the last frame: zeros, a cut record, or (if too long) damage."""
        self._final = True
        state = self._carried[0]
        zeros = int(state["zeros"]) if state["zeros"] >= _ZERO_RUN else 0
        damage = int(state["skipped"]) - zeros
        if damage > _LONGEST_RECORD:
            region = np.array([(state["base"] - damage - zeros, damage)], dtype=_kernel.REGION)
            self._keep(region)
            state["skipped"] = zeros


@cache
def _by_row(dialect: Dialect) -> tuple[NDArray[np.int16], NDArray[np.uint8], NDArray[np.int32]]:
    """Return a dialect as arrays for the kernel: row by message id, then crc_extra and size by row."""
    definitions = dialect.definitions
    ids = np.full(max(definitions) + 1, -1, dtype=np.int16)
    ids[list(definitions)] = np.arange(len(definitions))
    seeds = np.array([d.crc_extra for d in definitions.values()], dtype=np.uint8)
    largest = np.array([d.wire.itemsize for d in definitions.values()], dtype=np.int32)
    return ids, seeds, largest
