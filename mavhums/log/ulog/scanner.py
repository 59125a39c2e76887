"""Find the messages in a stream of bytes of a ULog, and tell what could not be read.

Where a block of bytes ends never matters: an unfinished message waits. Data that was appended to a log
later, as after a crash, begins where the flag bits say; the message before may be cut there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log.ulog import _kernel
from mavhums.log.ulog._headers import BODY
from mavhums.log.ulog.messages import flag_bits
from mavhums.log.ulog.topics import Topics

__all__ = ["HEADER", "SPARE", "Batch", "Totals", "UlogScanner"]

HEADER = 16
"""Bytes of a file's header: seven of signature, the version, the u64 time in microseconds since boot."""

SPARE = 8
_FLAGS_BODY = 40
_LONGEST_FLAGS = 1000
_DEFINING = np.frombuffer(b"FAR", dtype=np.uint8)
_REGIONS_KEPT = 1000
_ZERO_RUN = 16


class Totals(NamedTuple):
    """Counts of a scan so far; bytes, but for ``regions``, ``odd_times``, ``jumps`` and ``unknown``."""

    skipped: int
    regions: int
    cut_end: int
    zeros: int
    odd_times: int
    jumps: int
    unknown: int


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Messages of a buffer as ``_kernel.ROW``; behind what was scanned ``data`` has ``SPARE`` bytes more."""

    data: NDArray[np.uint8]
    base: int
    rows: NDArray[np.void]

    def body(self, row: np.void) -> bytes:
        """Return what follows a message's header."""
        begin = int(row["offset"]) - self.base + BODY
        return self.data[begin : begin + int(row["size"])].tobytes()


class UlogScanner:
    """Incremental scanner; feed it blocks of any size.

    Attributes
    ----------
    topics
        What the log says of its message ids.
    start_us
        The clock's first time, microseconds since boot.
    regions
        Offset and size of the first thousand damaged regions.
    """

    def __init__(self) -> None:
        self.topics = Topics()
        self.regions: list[tuple[int, int]] = []
        self._carried: NDArray[np.void] = np.zeros(1, dtype=_kernel.STATE)
        self._rest = b""
        self._boundaries: list[int] = []
        self._open = False
        self._skipped = self._count = self._cut = self._zeros = 0

    def feed(self, block: bytes, *, final: bool = False) -> Iterator[Batch]:
        """Yield the messages that ``block`` completes; ``final`` says that nothing follows."""
        self._rest += block
        if not self._open and not self._read_header(final):
            return
        base = int(self._carried["base"][0])
        while self._boundaries and self._boundaries[0] <= base + len(self._rest):
            boundary = self._boundaries.pop(0)
            if boundary > base:
                before, after = self._rest[: boundary - base], self._rest[boundary - base :]
                yield self._scan(before, final=True)
                self._rest, base = after, boundary
                self._carried["base"] = boundary
        yield self._scan(self._rest, final=final)

    @property
    def totals(self) -> Totals:
        """What was skipped and found odd so far."""
        state = self._carried[0]
        waiting = int(state["skipped"])
        return Totals(
            self._skipped + waiting,
            self._count + bool(waiting),
            self._cut,
            self._zeros,
            *(int(state[name]) for name in ("odd_times", "jumps", "unknown")),
        )

    def _read_header(self, final: bool) -> bool:
        """Read the file's header and its flag bits; return whether they are there."""
        end = HEADER + BODY
        size = int.from_bytes(self._rest[HEADER : HEADER + 2], "little")
        flagged = self._rest[HEADER + 2 : end] == b"B" and _FLAGS_BODY <= size <= _LONGEST_FLAGS
        if len(self._rest) < end + size * flagged and not final:
            return False
        self._open = True
        head = self._rest[:HEADER]
        self._carried["time_us"] = np.frombuffer(head[8:].ljust(8, b"\0"), dtype="<i8")
        if len(head) < HEADER:
            self._cut = len(head)
        elif flagged and len(self._rest) >= end + size:
            self._boundaries = list(flag_bits(self._rest[end : end + size]).appended)
            head = self._rest[: end + size]
        self._rest = self._rest[len(head) :]
        self._carried["base"] = len(head)
        return True

    def _scan(self, stream: bytes, *, final: bool) -> Batch:
        padded = np.frombuffer(stream + bytes(SPARE), dtype=np.uint8)
        data = padded[: len(stream)]
        rows: NDArray[np.void] = np.empty(data.size // 5 + 1, dtype=_kernel.ROW)
        regions: NDArray[np.void] = np.empty(data.size // BODY + 2, dtype=_kernel.REGION)
        state = self._carried[0]
        base = int(state["base"])
        for name in ("position", "found", "ended", "cut"):
            state[name] = 0
        handled = 0
        paused = True
        while paused:
            paused = bool(_kernel.scan(data, final, self._carried, self.topics.ids, rows, regions))
            found = int(state["found"])
            self._define(Batch(padded, base, rows[handled:found]))
            handled = found
        self._keep(regions[: int(state["ended"])])
        position = int(state["position"])
        self._rest = stream[position:]
        state["base"] += position
        if final:
            self._finish()
        return Batch(padded, base, rows[:handled])

    def _define(self, batch: Batch) -> None:
        for k in np.flatnonzero(np.isin(batch.rows["kind"], _DEFINING)).tolist():
            row = batch.rows[k]
            self.topics.take(int(row["kind"]), batch.body(row))

    def _keep(self, regions: NDArray[np.void]) -> None:
        self._skipped += int(regions["size"].sum())
        self._count += regions.size
        room = _REGIONS_KEPT - len(self.regions)
        self.regions += [(int(offset), int(size)) for offset, size in regions[:room]]

    def _finish(self) -> None:
        """Tell what follows the last message: zeros, a cut message, or damage."""
        state = self._carried[0]
        zeros = int(state["zeros"]) if state["zeros"] >= _ZERO_RUN else 0
        rest = int(state["skipped"]) - zeros
        self._zeros += zeros
        if state["cut"]:
            self._cut += rest
        elif rest:
            self._keep(np.array([(state["base"] - rest - zeros, rest)], dtype=_kernel.REGION))
        state["lost_step"] = state["skipped"] = state["zeros"] = 0
