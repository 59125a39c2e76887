"""Decoder of MAVLink streams: converts blocks of bytes to tables of messages."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mavhums.core.arrays import Records
from mavhums.log.base.decoder import Losses, Table
from mavhums.log.base.records import Definition, DefinitionTable
from mavhums.log.base.scanner import YEAR_2010_US, RecordBatch
from mavhums.log.mavlink.dialect import Dialect, load_dialect
from mavhums.log.mavlink.frames import MAGIC_V1, MAGIC_V2, STAMP
from mavhums.log.mavlink.scanner import FrameScanner
from mavhums.log.mavlink.sequence import StreamStats
from mavhums.log.mavlink.signing import SignatureGuard, frame_sizes

VEHICLE_MESSAGES = frozenset(
    {
        "ACTUATOR_OUTPUT_STATUS",
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "GLOBAL_POSITION_INT",
        "GPS_RAW_INT",
        "SERVO_OUTPUT_RAW",
        "SYS_STATUS",
        "VFR_HUD",
        "DEBUG_FLOAT_ARRAY",
    }
)
"""Messages that only a vehicle sends; a ground station sends heartbeats, too."""

_FIELD = "time_boot_ms"


class MavlinkDecoder:
    """Incremental decoder of a MAVLink telemetry log, in memory that does not grow with it.

    Parameters
    ----------
    messages
        Names of the message types that are wanted; all if None. Others are checked and counted
        but not unpacked.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    key
        32 bytes; only frames signed with it count. If None, signatures are not looked at.

    Raises
    ------
    DialectError
        If the XML cannot be used.

    Examples
    --------
    >>> MavlinkDecoder().feed(b"not a log", final=True)
    {}
    """

    format = "tlog"

    def __init__(
        self,
        messages: Iterable[str] | None = None,
        *,
        dialect: str | os.PathLike[str] | None = None,
        key: bytes | None = None,
    ) -> None:
        self._dialect = load_dialect(None if dialect is None else Path(dialect))
        self._wanted = None if messages is None else frozenset(messages)
        self._definitions = DefinitionTable()
        for definition in self._dialect.definitions.values():
            self._definitions.add(Definition(definition.name, definition.wire))
        self._intake = Intake(self._dialect)
        self._stats = StreamStats(self._dialect)
        self._clocks = _SenderClocks(self._dialect)
        self._received = _ReceiveClock()
        self._guard = None if key is None else SignatureGuard(key)
        self._scanner: FrameScanner | None = None

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (system, component, name), including unwanted ones."""
        return self._stats.counts

    @property
    def vehicles(self) -> tuple[int, ...]:
        """System ids of the vehicles."""
        return vehicles_of(self._stats.counts)

    @property
    def first_time_us(self) -> int | None:
        """Time of the first frame, microseconds of UTC; None before it."""
        return self._stats.first_time_us

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest frame, microseconds of UTC; None before the first."""
        return self._stats.last_time_us

    @property
    def unknown(self) -> dict[int, int]:
        """Number of frames by message id that the dialect does not define."""
        return dict(self._stats.unknown)

    @property
    def undated(self) -> bool:
        """Whether the log has no time stamps, so that times count from the sender's boot."""
        return self._intake.stamp == 0

    @property
    def ahead_us(self) -> int:
        """What is added to the times for UTC: by how much the receiver's clock was set while it recorded."""
        return self._received.ahead_us

    @property
    def losses(self) -> Losses:
        """Losses so far."""
        if self._scanner is None:
            return Losses()
        guard, bad = self._guard, self._scanner.bad_crc
        return self._scanner.losses(
            bad_crc_frames=int(bad.sum()),
            unknown_frames=sum(self._stats.unknown.values()),
            bad_crc_by_message={self._definitions.name(k): int(bad[k]) for k in np.flatnonzero(bad).tolist()},
            line_ends_restored=self._intake.line_ends,
            sequence=tuple(self._stats.sequence_losses()),
            unsigned_frames=guard.unsigned if guard else 0,
            bad_signatures=guard.bad if guard else 0,
            replayed_frames=guard.replayed if guard else 0,
        )

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        data = self._intake.feed(block, final=final)
        if self._scanner is None:
            if self._intake.stamp is None:
                return {}
            self._scanner = FrameScanner(self._dialect, stamp=self._intake.stamp)
        batch = self._scanner.feed(data, final=final)
        if self._guard:
            batch = replace(batch, rows=batch.rows[self._guard.admit(batch)])
        if batch.stamp == 0:
            self._clocks.set_times(batch)
        else:
            self._received.join(batch.rows)
        before = self._stats.frames
        self._stats.add(batch.rows)
        return self._definitions.gather(batch, self._wanted, ordinal=before).tables


def vehicles_of(counts: Mapping[tuple[int, int, str], int]) -> tuple[int, ...]:
    """Return the system ids that sent messages of vehicles; a heartbeat alone is not sufficient.

    Examples
    --------
    >>> vehicles_of({(255, 190, "HEARTBEAT"): 9, (1, 1, "ATTITUDE"): 5})
    (1,)
    """
    return tuple(sorted({system for system, _, name in counts if name in VEHICLE_MESSAGES}))


class _ReceiveClock:
    """Joins the times of a receiver whose clock began in 1970 and was then set to the date.

    Its step is no pause of the flight: the times go on as before it.
    """

    def __init__(self) -> None:
        self.ahead_us = 0
        self._last_us = -1

    def join(self, rows: Records) -> None:
        """Take the step out of the times of these frames."""
        if not rows.size:
            return
        times = rows["time_us"].copy()
        before = np.concatenate([[self._last_us], times[:-1]])
        steps = np.flatnonzero((before >= 0) & (before < YEAR_2010_US) & (times >= YEAR_2010_US))
        if steps.size and not self.ahead_us:
            self.ahead_us = int(times[steps[0]] - before[steps[0]])
        self._last_us = int(times[-1])
        rows["time_us"] = np.where(times >= YEAR_2010_US, times - self.ahead_us, times)


class _SenderClocks:
    """Assigns each frame the latest ``time_boot_ms`` of the first system that sends one.

    Before the first one the time is 0. A step back of up to a minute, for example from a message
    that waited in a queue, is ignored; a larger one is a reboot.
    """

    def __init__(self, dialect: Dialect) -> None:
        wires = [definition.wire for definition in dialect.definitions.values()]
        self._places = np.array(
            [wire.fields[_FIELD][1] if wire.fields and _FIELD in wire.fields else -1 for wire in wires],
            dtype=np.int64,
        )
        self._system: int | None = None
        self._time_us = 0

    def set_times(self, batch: RecordBatch) -> None:
        """Write the time of each frame into the batch's rows."""
        rows = batch.rows
        places = np.where(rows["definition"] >= 0, self._places[rows["definition"]], -1)
        speak = np.flatnonzero(places >= 0)
        if self._system is None and speak.size:
            self._system = int(rows["system"][speak[0]])
        speak = speak[rows["system"][speak] == self._system]
        begin = batch.places + rows["start"]
        stamps_us = np.zeros(speak.size, dtype=np.int64)
        for byte in range(4):
            at = places[speak] + byte
            sent = np.where(
                at < rows["length"][speak],
                batch.data[np.minimum(begin[speak] + at, batch.data.size - 1)],
                0,
            )
            stamps_us += sent.astype(np.int64) << (8 * byte)
        stamps_us *= 1000
        times = np.empty(rows.size, dtype=np.int64)
        done = 0
        for row, time_us in zip(speak.tolist(), stamps_us.tolist(), strict=True):
            times[done:row] = self._time_us
            if not self._time_us - 60_000_000 <= time_us < self._time_us:
                self._time_us = time_us
            done = row
        times[done:] = self._time_us
        rows["time_us"] = times


_CR, _LF, _CRLF = b"\r", b"\n", b"\r\n"
_EVIDENCE = 3  # carriage returns: one or two come by chance in a few kilobytes of binary data
_HELD = 1 << 12  # bytes in which a converted log has several line feeds, an original one a bare line feed
_HEAD = 1 << 10  # bytes: more than three of the longest frames
_CAPTURE = 1 << 14  # bytes: a second of a serial line at 115,200 baud, boot text included
_LEAST_ADJACENT = 2


class Intake:
    """Detects a stream's format from its bytes, reverses text conversion, and passes the bytes on.

    Bytes are buffered only until the format is known: up to 1 KiB if the stream begins with a magic
    byte, up to 16 KiB if it does not begin with a record. If the first line feed follows a carriage
    return, bytes are buffered until a line feed without one, or until 4 KiB contain more frames
    without the carriage returns.

    Attributes
    ----------
    stamp
        Size of the time stamp before each frame, bytes: 8 or 0; None until it is known.
    line_ends
        Number of carriage returns removed.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.stamp: int | None = None
        self.line_ends = 0
        self._dialect = dialect
        self._text: bool | None = None
        self._held = b""
        self._head = b""

    def feed(self, block: bytes, *, final: bool = False) -> bytes:
        """Return the bytes that can be decoded now; ``final`` marks the end of the stream."""
        data = self._restore(block, final)
        if self.stamp is not None:
            return data
        self._head += data
        self.stamp = self._stamp_of(self._head, final)
        if self.stamp is None:
            return b""
        data, self._head = self._head, b""
        return data

    def _restore(self, block: bytes, final: bool) -> bytes:
        if self._text is False:
            return block
        data, self._held = self._held + block, b""
        before = b""
        if self._text is None:
            first = data.find(_LF)
            if first >= 0:
                begin = max(first - 1, 0)
                before, data = data[:begin], data[begin:]
                self._text = self._is_text(data, final)
                if self._text is False:
                    return before + data
                if self._text is None:
                    self._held = data
                    return before
        if data.endswith(_CR) and not final:
            data, self._held = data[:-1], _CR
        if self._text:
            whole = len(data)
            data = data.replace(_CRLF, _LF)
            self.line_ends += whole - len(data)
        return before + data

    def _is_text(self, data: bytes, final: bool) -> bool | None:
        """Return whether ``data``, from the first line feed on, was converted; None if not yet known."""
        head = data[:_HELD]
        if head.count(_LF) > head.count(_CRLF):
            return False
        if len(head) < _HELD and not final:
            return None
        restored = head.replace(_CRLF, _LF)
        return len(head) - len(restored) >= _EVIDENCE and self._frames(restored) > self._frames(head)

    def _frames(self, data: bytes) -> int:
        return FrameScanner(self._dialect).feed(data, final=True).rows.size

    def _stamp_of(self, head: bytes, final: bool) -> int | None:
        """Return the size of the time stamp before each frame, bytes; None if not yet known."""
        if not head:
            return None
        if head[0] in (MAGIC_V1, MAGIC_V2):
            if len(head) < _HEAD and not final:
                return None
            if self._is_back_to_back(head[:_HEAD]):
                return 0
        elif self._begins_with_record(head[:_HEAD]):
            return 8
        if len(head) < _CAPTURE and not final:
            return None
        return 0 if self._is_capture(head[:_CAPTURE]) else 8

    def _begins_with_record(self, head: bytes) -> bool:
        rows = FrameScanner(self._dialect).feed(head).rows
        return bool(rows.size and rows["offset"][0] == 0)

    def _is_capture(self, head: bytes) -> bool:
        """Return whether more frames follow another directly than after the size of a time stamp."""
        rows = FrameScanner(self._dialect, stamp=0).feed(head, final=True).rows
        gaps = rows["offset"][1:] - (rows["offset"] + frame_sizes(rows))[:-1]
        adjacent = int((gaps == 0).sum())
        return adjacent >= _LEAST_ADJACENT and adjacent > int((gaps == STAMP).sum())

    def _is_back_to_back(self, head: bytes) -> bool:
        rows = FrameScanner(self._dialect, stamp=0).feed(head, final=True).rows
        if rows.size == 0 or rows["offset"][0] or rows["definition"][0] < 0:
            return False
        size = int(frame_sizes(rows)[0])
        return size >= len(head) or head[size] in (MAGIC_V1, MAGIC_V2)
