"""Decoder of PX4's ULog: converts blocks of bytes to tables.

Data is converted by the layout of its topic, each other kind of message by its parser.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Integers
from mavhums.log.base.decoder import Losses, Table, join_tables
from mavhums.log.base.records import Definition, DefinitionTable
from mavhums.log.base.scanner import RecordBatch, is_date, plausible
from mavhums.log.ulog.layouts import BASIC, Layout
from mavhums.log.ulog.scanner import UlogScanner

_INSTANCES = 256
_HELD_BYTES = 1 << 20  # bytes that may wait for a fix; without one in them the log has no date
_DATA, _PARAMETER = b"DP"
_VEHICLE: Final = b"MAV_SYS_ID"
_GPS: Final = "vehicle_gps_position"
_FIX_3D = 3

_TEXT_BYTES: Final = 255
_PARAMETER_ROW: Final = np.dtype([("name", "S64"), ("type", "S16"), ("value", "<f8")])
_STRING_ROW: Final = np.dtype(
    [("timestamp", "<u8"), ("level", "u1"), ("tag", "<u2"), ("text", f"S{_TEXT_BYTES}")]
)
_INFO_ROW: Final = np.dtype([("name", "S64"), ("type", "S16"), ("value", f"S{_TEXT_BYTES}")])
_DROPOUT_ROW: Final = np.dtype([("duration_ms", "<u2")])

Fields = tuple[object, ...]


class _MessageParser(NamedTuple):
    """The table of a message kind, and its parser."""

    table: str
    wire: np.dtype[np.void]
    read: Callable[[bytes], Fields | None]


def _parameter(body: bytes) -> tuple[bytes, bytes, float] | None:
    """Return name, type and value of a parameter; None if the message is invalid."""
    kind, name, value = _keyed(body)
    if kind not in (b"int32_t", b"float") or len(value) != 4:
        return None
    return name, kind, float(np.frombuffer(value, dtype=BASIC[kind.decode()])[0])


def _info(body: bytes) -> Fields | None:
    kind, name, value = _keyed(body)
    if not kind.startswith(b"char["):
        form = np.dtype(BASIC.get(kind.decode("ascii", "replace"), "S1"))
        if form.kind == "S" or len(value) != form.itemsize:
            return None
        value = str(np.frombuffer(value, dtype=form)[0]).encode()
    return name, kind, value[:_TEXT_BYTES]


def _string(body: bytes, tag_bytes: int) -> Fields:
    time, text = 1 + tag_bytes, 9 + tag_bytes
    time_us, tag = (int.from_bytes(part, "little") for part in (body[time:text], body[1:time]))
    return time_us, body[0] - 48, tag, body[text : text + _TEXT_BYTES]


def _dropout(body: bytes) -> Fields:
    return (int.from_bytes(body, "little"),)


def _keyed(body: bytes) -> tuple[bytes, bytes, bytes]:
    """Return type, name and value of a message ``length type name value``."""
    end = 1 + body[0]
    kind, _, name = body[1:end].partition(b" ")
    return kind, name, body[end:]


_PARSERS: Final = {
    ord("P"): _MessageParser("parameter", _PARAMETER_ROW, _parameter),
    ord("I"): _MessageParser("info", _INFO_ROW, _info),
    ord("L"): _MessageParser("logged_string", _STRING_ROW, partial(_string, tag_bytes=0)),
    ord("C"): _MessageParser("logged_string", _STRING_ROW, partial(_string, tag_bytes=2)),
    ord("O"): _MessageParser("dropout", _DROPOUT_ROW, _dropout),
}
"""By kind. Defaults of parameters (Q), and information in many parts (M), are passed over."""


class UlogDecoder:
    """Incremental decoder of a ULog, in memory that does not grow with it.

    Tables have the names of topics; additional tables are ``parameter``, ``logged_string``, ``info`` and
    ``dropout``. A table's component is the topic's multi id. Times are the autopilot's, since boot, converted
    to UTC by the first 3-D fix in the first megabyte; earlier data is buffered until then.

    Parameters
    ----------
    messages
        Names of the wanted tables; all if None. Others are checked and counted but not
        unpacked.

    Attributes
    ----------
    undated
        Whether the log has no satellite time, so that times count from the vehicle's boot.

    Examples
    --------
    >>> UlogDecoder().feed(b"ULog", final=True)
    {}
    """

    ahead_us = 0
    format = "ulog"

    def __init__(self, messages: Collection[str] | None = None) -> None:
        self._scanner = UlogScanner()
        self._wanted = None if messages is None else frozenset(messages)
        self._definitions = DefinitionTable(counts_undefined=True)
        self._vehicle, self._offset_us = 1, 0
        self._others: Counter[str] = Counter()
        self._frames = 0
        self.undated, self._settled = True, False
        self._held: list[RecordBatch] = []
        self._first_us: int | None = None
        self._last_us: int | None = None
        self._counts: Integers = np.zeros((0, _INSTANCES), dtype=np.int64)

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (vehicle, multi id, name), wanted or not."""
        counts = {(self._vehicle, 0, name): n for name, n in self._others.items()}
        for layout, instance in zip(*(axis.tolist() for axis in np.nonzero(self._counts)), strict=True):
            name = self._scanner.topics.layouts[layout].name
            counts[self._vehicle, instance, name] = int(self._counts[layout, instance])
        return counts

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Id of the vehicle, ``MAV_SYS_ID``; none before the first data."""
        return (self._vehicle,) if self._counts.any() else ()

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records by message id without a layout; -1 means messages of unknown kinds."""
        kinds = self._scanner.totals.unknown
        return self._scanner.topics.unknown | ({-1: kinds} if kinds else {})

    @property
    def losses(self) -> Losses:
        """Losses so far: unreadable data, and the number of pauses of the logger."""
        pauses = self._others["dropout"]
        return self._scanner.losses(unknown_frames=sum(self.unknown.values()), logger_dropped=pauses)

    @property
    def first_time_us(self) -> int | None:
        """Time of the first data, microseconds of UTC; None before it."""
        return None if self._first_us is None else self._first_us + self._offset_us

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest data, microseconds of UTC; None before the first."""
        return None if self._last_us is None else self._last_us + self._offset_us

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        parts: list[Table] = []
        for batch in self._scanner.feed(block, final=final):
            if not self._settled:
                self._take_early_facts(batch)
            self._account(batch)
            if batch.rows.size:
                self._held.append(batch)
            if self._settled:
                parts += self._release()
        if final:
            self._settled = True
            parts += self._release()
        return join_tables(parts)

    def _release(self) -> list[Table]:
        """Return the tables of the batches that waited for the date."""
        tables = [table for batch in self._held for table in self._tables(batch)]
        self._held.clear()
        return tables

    def _tables(self, batch: RecordBatch) -> Iterator[Table]:
        yield from self._other_tables(batch)
        for layout in self._scanner.topics.layouts[len(self._definitions) :]:
            self._definitions.add(Definition(layout.name, layout.wire))
        context = {"ordinal": self._frames, "shift_us": self._offset_us, "vehicle": self._vehicle}
        yield from self._definitions.gather(batch, self._wanted, **context).tables.values()
        self._frames += batch.rows.size

    def _other_tables(self, batch: RecordBatch) -> Iterator[Table]:
        """Yield parameters, texts, information and dropouts."""
        found: dict[str, list[tuple[int, Fields]]] = {}
        for k in np.flatnonzero(batch.rows["number"] != _DATA).tolist():
            parser = _PARSERS.get(int(batch.rows["number"][k]))
            if parser is None:
                continue
            self._others[parser.table] += 1
            if self._wanted is None or parser.table in self._wanted:
                parsed = parser.read(batch.payload(batch.rows[k]))
                if parsed is not None:
                    found.setdefault(parser.table, []).append((k, parsed))
        for table, wire in {parser.table: parser.wire for parser in _PARSERS.values()}.items():
            if table in found:
                places, parsed_rows = zip(*found[table], strict=True)
                rows = batch.rows[list(places)]
                fields = np.array(list(parsed_rows), dtype=wire)
                frame = np.array(places, dtype=np.int64) + self._frames
                vehicle, zeros = np.full(rows.size, self._vehicle, np.uint8), np.zeros(rows.size, np.uint8)
                time_us = rows["time_us"] + self._offset_us
                yield Table(table, frame, time_us, vehicle, zeros, zeros, zeros, fields)

    def _account(self, batch: RecordBatch) -> None:
        missing = len(self._scanner.topics.layouts) - len(self._counts)
        if missing:
            self._counts = np.vstack([self._counts, np.zeros((missing, _INSTANCES), dtype=np.int64)])
        records = batch.rows[batch.rows["definition"] >= 0]
        places = records["definition"].astype(np.int64) * _INSTANCES + records["component"]
        self._counts += np.bincount(places, minlength=self._counts.size).reshape(self._counts.shape)
        if self._first_us is None:
            data = np.flatnonzero((batch.rows["number"] == _DATA) & (batch.rows["flags"] == 0))
            self._first_us = int(batch.rows["time_us"][data[0]]) if data.size else None
        if self._first_us is not None and batch.rows.size:
            latest_us = int(batch.rows["time_us"].max())
            self._last_us = max(self._last_us or self._first_us, latest_us)

    def _take_early_facts(self, batch: RecordBatch) -> None:
        """Process the vehicle's id before its first data, and the first fix in the first megabyte."""
        rows = batch.rows
        if self._first_us is None:
            before_data = np.cumsum(rows["number"] == _DATA) == 0
            for row in rows[before_data & (rows["number"] == _PARAMETER)]:
                parsed = _parameter(batch.payload(row))
                if parsed is not None and parsed[:2] == (_VEHICLE, b"int32_t"):
                    self._vehicle = int(parsed[2]) & 0xFF
        for k, layout in enumerate(self._scanner.topics.layouts):
            if layout.name == _GPS and layout.stamp >= 0 and layout.has("time_utc_usec", "u8"):
                there = (rows["definition"] == k) & (rows["offset"] < _HELD_BYTES) & (rows["flags"] == 0)
                for row in rows[there]:
                    offset_us = _utc_offset(layout, batch.payload(row))
                    if offset_us is not None:
                        self._offset_us, self.undated, self._settled = offset_us, False, True
                        return
        # Not the end of the block: a record that it cuts may still be a fix within the megabyte.
        self._settled = self._scanner.position >= _HELD_BYTES


def _utc_offset(layout: Layout, body: bytes) -> int | None:
    """Return the offset from boot time to UTC by a fix, microseconds; None if it is not a valid 3-D fix."""
    fix = np.frombuffer(body, dtype=layout.wire, count=1)[0]
    utc_us = int(fix["time_utc_usec"])
    if layout.has("fix_type", "u1") and fix["fix_type"] < _FIX_3D:
        return None
    offset_us = utc_us - int(fix["timestamp"])
    return offset_us if is_date(utc_us) and plausible(offset_us) else None
