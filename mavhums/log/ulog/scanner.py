"""Scanner that finds the messages in a ULog, and reports the unreadable parts.

Results do not depend on where a block of bytes ends: an unfinished message waits. Data appended to a log
later, for example after a crash, begins at the offset in the flag bits; the message before may be cut there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mavhums.core.arrays import Bytes
from mavhums.log.base.scanner import REGION, Batch, BlockScanner
from mavhums.log.base.unaligned_io import GUARD, SPARE
from mavhums.log.ulog.headers import BODY
from mavhums.log.ulog.layouts import Topics
from mavhums.log.ulog.messages import flag_bits
from mavhums.log.ulog.scan import ROW, STATE, scan

__all__ = ["HEADER", "SIGNATURE", "UlogScanner"]

HEADER = 16
"""Bytes of a file's header: seven of signature, the version, the u64 time in microseconds since boot."""

SIGNATURE = b"ULog\x01\x12\x35"
_FLAGS_BODY = 40
_LONGEST_FLAGS = 1000
_DEFINING = np.isin(np.arange(256), np.frombuffer(b"FAR", dtype=np.uint8))
_ANY_LENGTH = 1 << 62


class UlogScanner(BlockScanner):
    """Incremental scanner of blocks of any size.

    Attributes
    ----------
    topics
        The log's message ids.
    """

    def __init__(self) -> None:
        super().__init__(ROW, STATE, shortest=BODY)
        self.topics = Topics()
        self._boundaries: list[int] = []
        self._open = False

    def feed(self, block: bytes, *, final: bool = False) -> Iterator[Batch]:
        """Yield the messages that ``block`` completes; ``final`` says that nothing follows."""
        joined = self._joined(block)
        begin, end = GUARD, len(joined) - SPARE
        if not self._open:
            begin += self._read_header(joined[GUARD:end], final)
            if not self._open:
                self._carry(joined, GUARD)
                return
        data = np.frombuffer(joined, dtype=np.uint8)
        before = self.position - begin
        while self._boundaries and self._boundaries[0] <= before + end:
            boundary = self._boundaries.pop(0) - before
            if boundary > begin:
                yield self._scan(data, begin, boundary, final=True)
                begin = boundary
        batch = self._scan(data, begin, end, final=final)
        self._carry(joined, begin + int(self._carried["position"][0]))
        yield batch

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
            self._add_damage(np.array([(0, HEADER)], dtype=REGION))
        self._carried["time_us"] = np.frombuffer(head[8:HEADER].ljust(8, b"\0"), dtype="<i8")
        place = min(HEADER, len(head))
        if place < HEADER:
            self._cut = place
        elif flagged and len(head) >= end + size:
            self._boundaries = list(flag_bits(head[end : end + size]).appended)
            place = end + size
        self._carried["base"] = place
        return place

    def _scan(self, data: Bytes, begin: int, end: int, *, final: bool) -> Batch:
        """Scan a part of the buffer; ``position`` is where in it the scan stopped."""
        state = self._carried[0]
        batch = Batch(data[begin - GUARD : end + SPARE], self.position, self._rows[:0])
        for name in ("position", "found", "ended", "cut"):
            state[name] = 0
        handled, paused = 0, True
        while paused:
            paused = bool(
                scan(data[begin:end], final, self._carried, self.topics.ids, self._rows, self._damaged)
            )
            found = int(state["found"])
            for row in self._rows[handled:found][_DEFINING[self._rows["kind"][handled:found]]]:
                self.topics.observe(int(row["kind"]), batch.payload(row))
            handled = found
        self._add_damage(self._damaged[: int(state["ended"])])
        state["base"] += state["position"]
        if final:
            # The kernel knows whether the end cuts a message; else the rest is damage, of any length.
            self._finish(longest=_ANY_LENGTH if state["cut"] else 0)
            state["lost_step"] = 0
        # A copy: messages wait for the flight's date while the next blocks are scanned.
        return Batch(batch.data, batch.base, self._rows[:handled].copy())
