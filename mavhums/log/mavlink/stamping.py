"""Converts bytes received over links to time-stamped records of a telemetry log.

Each sender has its own stream of bytes: a frame may be divided between two pieces of one sender, but
never between two senders. Every accepted frame becomes one record, with the reception time of the
piece that completed it. A frame with a bad CRC is always rejected, even if restored zeros would
correct it: on a link, bit errors are far more frequent than senders that trim after the CRC.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from mavhums.core.arrays import Bytes1, Integers, Integers1
from mavhums.core.kernels import kernel
from mavhums.log.base.decoder import MAVLINK1
from mavhums.log.base.scanner import GUARD, RecordBatch
from mavhums.log.mavlink.dialect import Dialect
from mavhums.log.mavlink.frames import STAMP
from mavhums.log.mavlink.scanner import FrameScanner
from mavhums.log.mavlink.signing import SignatureGuard, frame_sizes

_SENDERS = 64


class Piece(NamedTuple):
    """A datagram, or bytes of a stream, with sender and time of reception (microseconds of UTC).

    With several links, a sender is a pair: the link, and the sender on that link.
    """

    sender: Hashable
    time_us: int
    data: bytes


@dataclass(slots=True)
class Counts:
    """Counts of what the links received so far.

    ``frames`` counts the frames that became records; ``unknown_frames`` are those among them whose
    message the dialect lacks. ``bytes_skipped`` belong to no frame.
    """

    pieces: int = 0
    bytes: int = 0
    frames: int = 0
    unknown_frames: int = 0
    bytes_skipped: int = 0
    bad_crc_frames: int = 0
    unsigned_frames: int = 0
    bad_signatures: int = 0
    replayed_frames: int = 0


class _SenderFrames(NamedTuple):
    """Frames of one sender: their buffer, rows, times, and order of arrival."""

    sender: Hashable
    batch: RecordBatch
    time_us: Integers
    arrival: Integers


class Hear(Protocol):
    """Callback for accepted frames: the sender, its systems, bytes, and time, microseconds of UTC."""

    def __call__(self, sender: Hashable, systems: set[int], size: int, time_us: int, /) -> None:
        """Take the frame's particulars."""


class Stamper:
    """Converts pieces to records, in bounded memory.

    If there are more than 64 senders, one of the link with most senders is dropped, with its
    incomplete frame: one that never sent a frame, else the least recently active one.

    Parameters
    ----------
    dialect
        Dialect of the known messages.
    guard
        Decides which signed frames are accepted; None ignores signatures.
    hear
        Called for each sender with accepted frames.

    Attributes
    ----------
    speaks_mavlink2
        Whether a MAVLink 2 frame has been received.
    """

    def __init__(
        self, dialect: Dialect, guard: SignatureGuard | None = None, *, hear: Hear | None = None
    ) -> None:
        self.speaks_mavlink2 = False
        self._dialect = dialect
        self._guard = guard
        self._counts = Counts()
        self._streams: OrderedDict[Hashable, _SenderStream] = OrderedDict()
        self._hear = hear

    @property
    def counts(self) -> Counts:
        """Counts so far."""
        counts = replace(self._counts)
        for stream in self._streams.values():
            _add_losses(counts, stream)
        if self._guard:
            counts.unsigned_frames = self._guard.unsigned
            counts.bad_signatures = self._guard.bad
            counts.replayed_frames = self._guard.replayed
        return counts

    @property
    def frames(self) -> int:
        """Number of frames that became records."""
        return self._counts.frames

    def feed(self, pieces: Sequence[Piece]) -> bytes:
        """Return the records of the frames that these pieces complete; their times must not decrease."""
        found: list[_SenderFrames] = []
        senders: dict[Hashable, list[int]] = {}
        for k, piece in enumerate(pieces):
            senders.setdefault(piece.sender, []).append(k)
        arrived_us = np.array([piece.time_us for piece in pieces], dtype=np.int64)
        for sender, places in senders.items():
            stream = self._streams.get(sender)
            if stream is None:
                stream = self._streams[sender] = _SenderStream(self._dialect)
            self._streams.move_to_end(sender)
            batch, by = stream.feed([pieces[k].data for k in places])
            self._forget()
            if batch.rows.size:
                arrival = np.array(places)[by]
                found.append(_SenderFrames(sender, batch, arrived_us[arrival], arrival))
        self._counts.pieces += len(pieces)
        self._counts.bytes += sum(len(piece.data) for piece in pieces)
        return self._records(found)

    def close(self, time_us: int) -> bytes:
        """Return the records of the last frames, which waited for more bytes; the stream ends."""
        streams, self._streams = self._streams, OrderedDict()
        found = []
        for sender, stream in streams.items():
            batch = stream.scanner.feed(b"", final=True)
            times = np.full(batch.rows.size, time_us, dtype=np.int64)
            found.append(_SenderFrames(sender, batch, times, np.zeros_like(times)))
            _add_losses(self._counts, stream)
        return self._records([part for part in found if part.batch.rows.size])

    def _forget(self) -> None:
        if len(self._streams) > _SENDERS:
            ((crowded, _),) = Counter(map(_link, self._streams)).most_common(1)
            there = [sender for sender in self._streams if _link(sender) == crowded]
            sender = next((sender for sender in there if not self._streams[sender].frames), there[0])
            stream = self._streams.pop(sender)
            stream.scanner.feed(b"", final=True)
            _add_losses(self._counts, stream)

    def _records(self, found: Sequence[_SenderFrames]) -> bytes:
        """Pack admitted frames as records, in order of arrival."""
        if not found:
            return b""
        data = np.concatenate([part.batch.data for part in found])
        bases = np.cumsum([0, *(part.batch.data.size for part in found[:-1])])
        order = np.argsort(np.concatenate([part.arrival for part in found]), kind="stable")
        rows = np.concatenate([part.batch.rows for part in found])[order]
        starts = np.concatenate([p.batch.places + base for p, base in zip(found, bases, strict=True)])[order]
        time_us = np.concatenate([part.time_us for part in found])[order]
        owner = np.repeat(np.arange(len(found)), [part.batch.rows.size for part in found])[order]
        if self._guard:
            rows["offset"] = starts
            admitted = self._guard.admit(RecordBatch(data, GUARD, rows))
            rows, starts, time_us = rows[admitted], starts[admitted], time_us[admitted]
            owner = owner[admitted]
        sizes = frame_sizes(rows)
        for k, part in enumerate(found):
            own = owner == k
            if self._hear and own.any():
                systems = set(rows["system"][own].tolist())
                self._hear(part.sender, systems, int(sizes[own].sum()), int(time_us[-1]))
        self._counts.frames += rows.size
        self._counts.unknown_frames += int(np.count_nonzero(rows["definition"] < 0))
        self.speaks_mavlink2 |= bool(((rows["flags"] & MAVLINK1) == 0).any())
        out = np.empty(int(sizes.sum()) + STAMP * sizes.size, dtype=np.uint8)
        _pack(data, starts, sizes, time_us, out)
        return out.tobytes()


class _SenderStream:
    """The byte stream of one sender."""

    def __init__(self, dialect: Dialect) -> None:
        self.scanner = FrameScanner(dialect, stamp=0, mend=False)
        self.frames = 0
        self._fed = 0

    def feed(self, pieces: Sequence[bytes]) -> tuple[RecordBatch, Integers]:
        """Return the frames that these pieces complete, and the index of each frame's last piece."""
        batch = self.scanner.feed(b"".join(pieces))
        ends = self._fed + np.cumsum([len(piece) for piece in pieces])
        self._fed = int(ends[-1])
        self.frames += batch.rows.size
        return batch, np.searchsorted(ends, batch.rows["offset"] + frame_sizes(batch.rows))


def _link(sender: Hashable) -> Hashable:
    return sender[0] if isinstance(sender, tuple) else None


def _add_losses(counts: Counts, stream: _SenderStream) -> None:
    totals = stream.scanner.totals
    counts.bytes_skipped += max(totals.skipped, 0) + totals.cut_end
    counts.bad_crc_frames += int(stream.scanner.bad_crc.sum())


@kernel
def _pack(
    data: Bytes1,
    starts: Integers1,
    sizes: Integers1,
    time_us: Integers1,
    out: Bytes1,
) -> None:
    """Write records to ``out``: the time, eight bytes big-endian, then a frame of ``data``."""
    place = 0
    for k in range(starts.size):
        for j in range(8):
            out[place + j] = (time_us[k] >> (56 - 8 * j)) & 0xFF
        place += 8
        out[place : place + sizes[k]] = data[starts[k] : starts[k] + sizes[k]]
        place += sizes[k]
