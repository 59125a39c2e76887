"""Scanner that finds the messages in a ULog, and reports the unreadable parts.

Results do not depend on where a block of bytes ends: an unfinished message waits. Data appended to a log
later, for example after a crash, begins at the offset in the flag bits; the message before may be cut there.
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

__all__ = ["HEADER", "SIGNATURE", "SPARE", "Batch", "Totals", "UlogScanner"]

HEADER = 16
"""Bytes of a file's header: seven of signature, the version, the u64 time in microseconds since boot."""

SIGNATURE = b"ULog\x01\x12\x35"
SPARE = 8
_FLAGS_BODY = 40
_LONGEST_FLAGS = 1000
_DEFINING = np.isin(np.arange(256), np.frombuffer(b"FAR", dtype=np.uint8))
_REGIONS_KEPT = 1000
_ZERO_RUN = 16


class Totals(NamedTuple):
    """Counts of a scan so far, in bytes except ``regions``, ``odd_times``, ``jumps`` and ``unknown``."""

    skipped: int
    regions: int
    cut_end: int
    zeros: int
    odd_times: int
    jumps: int
    unknown: int


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Messages of a buffer as ``_kernel.ROW``; ``data`` has ``SPARE`` bytes after the scanned part."""

    data: NDArray[np.uint8]
    base: int
    rows: NDArray[np.void]

    def copy(self) -> Batch:
        """Return a copy that stays valid after the next call."""
        return Batch(self.data.copy(), self.base, self.rows.copy())

    def body(self, row: np.void) -> bytes:
        """Return the body of a message."""
        begin = int(row["offset"]) - self.base + BODY
        return self.data[begin : begin + int(row["size"])].tobytes()


class UlogScanner:
    """Incremental scanner of blocks of any size.

    Attributes
    ----------
    topics
        The log's message ids.
    start_us
        The clock's first time, microseconds since boot.
    regions
        Offset and size of the first thousand damaged regions.
    """

    def __init__(self) -> None:
        self.topics = Topics()
        self.regions: list[tuple[int, int]] = []
        self._carried: NDArray[np.void] = np.zeros(1, dtype=_kernel.STATE)
        self._rows: NDArray[np.void] = np.empty(0, dtype=_kernel.ROW)
        self._buffer: NDArray[np.uint8] = np.zeros(SPARE, dtype=np.uint8)
        self._rest = slice(0, 0)
        self._boundaries: list[int] = []
        self._open = False
        self._skipped = self._count = self._cut = self._zeros = 0

    def feed(self, block: bytes, *, final: bool = False) -> Iterator[Batch]:
        """Yield the messages that ``block`` completes; ``final`` says that nothing follows.

        A batch is valid until the next call.
        """
        begin, end = 0, self._append(block)
        if not self._open:
            begin = self._read_header(self._buffer[:end].tobytes(), final)
            if not self._open:
                return
        base = int(self._carried["base"][0]) - begin
        while self._boundaries and self._boundaries[0] <= base + end:
            boundary = self._boundaries.pop(0)
            if boundary > base + begin:
                yield self._scan(begin, boundary - base, final=True)
                begin = boundary - base
        batch = self._scan(begin, end, final=final)
        self._rest = slice(begin + int(self._carried["position"][0]), end)
        yield batch

    def _append(self, block: bytes) -> int:
        """Append a block to the unfinished bytes at the start of the buffer; return its end."""
        rest = self._buffer[self._rest].copy()
        end = rest.size + len(block)
        if self._buffer.size < end + SPARE:
            self._buffer = np.zeros(2 * end + SPARE, dtype=np.uint8)
        self._buffer[: rest.size] = rest
        self._buffer[rest.size : end] = np.frombuffer(block, dtype=np.uint8)
        self._rest = slice(0, end)
        return end

    @property
    def totals(self) -> Totals:
        """Counts of skipped bytes and irregular messages so far."""
        state = self._carried[0]
        waiting = int(state["skipped"])
        return Totals(
            self._skipped + waiting,
            self._count + bool(waiting),
            self._cut,
            self._zeros,
            *(int(state[name]) for name in ("odd_times", "jumps", "unknown")),
        )

    def _read_header(self, head: bytes, final: bool) -> int:
        """Read the file's header and its flag bits, if they are complete; return their end."""
        end = HEADER + BODY
        size = int.from_bytes(head[HEADER : HEADER + 2], "little")
        flagged = head[HEADER + 2 : end] == b"B" and _FLAGS_BODY <= size <= _LONGEST_FLAGS
        if len(head) < end + size * flagged and not final:
            return 0
        self._open = True
        damaged = not SIGNATURE.startswith(head[: len(SIGNATURE)])
        if damaged and not flagged:  # whatever is left of the header is skipped as damage
            return 0
        if damaged:
            self._keep(np.array([(0, HEADER)], dtype=_kernel.REGION))
        self._carried["time_us"] = np.frombuffer(head[8:HEADER].ljust(8, b"\0"), dtype="<i8")
        place = min(HEADER, len(head))
        if place < HEADER:
            self._cut = place
        elif flagged and len(head) >= end + size:
            self._boundaries = list(flag_bits(head[end : end + size]).appended)
            place = end + size
        self._carried["base"] = place
        return place

    def _scan(self, begin: int, end: int, *, final: bool) -> Batch:
        """Scan a part of the buffer; ``position`` is the position at which the scan stopped."""
        padded, data = self._buffer[begin : end + SPARE], self._buffer[begin:end]
        if self._rows.size < data.size // 5 + 1:
            self._rows = np.empty(data.size // 5 + 1, dtype=_kernel.ROW)
        regions: NDArray[np.void] = np.empty(data.size // BODY + 2, dtype=_kernel.REGION)
        state = self._carried[0]
        base = int(state["base"])
        for name in ("position", "found", "ended", "cut"):
            state[name] = 0
        handled, paused = 0, True
        while paused:
            paused = bool(_kernel.scan(data, final, self._carried, self.topics.ids, self._rows, regions))
            found = int(state["found"])
            self._define(Batch(padded, base, self._rows[handled:found]))
            handled = found
        self._keep(regions[: int(state["ended"])])
        state["base"] += state["position"]
        if final:
            self._finish()
        return Batch(padded, base, self._rows[:handled])

    def _define(self, batch: Batch) -> None:
        for row in batch.rows[_DEFINING[batch.rows["kind"]]]:
            self.topics.take(int(row["kind"]), batch.body(row))

    def _keep(self, regions: NDArray[np.void]) -> None:
        self._skipped += int(regions["size"].sum())
        self._count += regions.size
        room = _REGIONS_KEPT - len(self.regions)
        self.regions += [(int(offset), int(size)) for offset, size in regions[:room]]

    def _finish(self) -> None:
        """Classify the bytes after the last message: zeros, a cut message, or damage."""
        state = self._carried[0]
        zeros = int(state["zeros"]) if state["zeros"] >= _ZERO_RUN else 0
        rest = int(state["skipped"]) - zeros
        self._zeros += zeros
        if state["cut"]:
            self._cut += rest
        elif rest:
            self._keep(np.array([(state["base"] - rest - zeros, rest)], dtype=_kernel.REGION))
        state["lost_step"] = state["skipped"] = state["zeros"] = 0
