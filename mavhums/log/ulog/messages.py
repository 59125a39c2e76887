"""Converts the messages of a ULog to tables: data by its layout, each other kind by its parser."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from mavhums.log.base.records import DefinitionTable, RowContext
from mavhums.log.base.scanner import RecordBatch
from mavhums.log.base.tables import Table
from mavhums.log.ulog.layouts import BASIC, Layout

__all__ = ["FlagBits", "Unpacker", "flag_bits", "parameter"]

_DATA = ord("D")

TEXT_BYTES: Final = 255
PARAMETER: Final = np.dtype([("name", "S64"), ("type", "S16"), ("value", "<f8")])
STRING: Final = np.dtype([("timestamp", "<u8"), ("level", "u1"), ("tag", "<u2"), ("text", f"S{TEXT_BYTES}")])
INFO: Final = np.dtype([("name", "S64"), ("type", "S16"), ("value", f"S{TEXT_BYTES}")])
DROPOUT: Final = np.dtype([("duration_ms", "<u2")])

Row = tuple[object, ...]


class FlagBits(NamedTuple):
    """The log's first message: whether the log can be read, and where data was appended later."""

    incompatible: bool
    appended: tuple[int, ...]


class _MessageParser(NamedTuple):
    """The table of a message kind, and its parser."""

    table: str
    wire: np.dtype[np.void]
    read: Callable[[bytes], Row | None]


def flag_bits(body: bytes) -> FlagBits:
    """Parse a flag-bits message of at least 40 bytes.

    Examples
    --------
    >>> flag_bits(bytes(8) + b"\\x01" + bytes(7) + (500).to_bytes(8, "little") + bytes(16))
    FlagBits(incompatible=False, appended=(500,))
    """
    unknown = body[8] & 0xFE or any(body[9:16])
    offsets = struct.unpack("<3Q", body[16:40]) if body[8] & 1 else ()
    return FlagBits(bool(unknown), tuple(sorted(offset for offset in offsets if offset)))


def parameter(body: bytes) -> tuple[bytes, bytes, float] | None:
    """Return name, type and value of a parameter; None if the message is invalid."""
    kind, name, value = _keyed(body)
    if kind not in (b"int32_t", b"float") or len(value) != 4:
        return None
    return name, kind, float(np.frombuffer(value, dtype=BASIC[kind.decode()])[0])


def _info(body: bytes) -> Row | None:
    kind, name, value = _keyed(body)
    if not kind.startswith(b"char["):
        form = np.dtype(BASIC.get(kind.decode("ascii", "replace"), "S1"))
        if form.kind == "S" or len(value) != form.itemsize:
            return None
        value = str(np.frombuffer(value, dtype=form)[0]).encode()
    return name, kind, value[:TEXT_BYTES]


def _string(body: bytes) -> Row:
    return int.from_bytes(body[1:9], "little"), body[0] - 48, 0, body[9 : 9 + TEXT_BYTES]


def _tagged_string(body: bytes) -> Row:
    tag, time_us = struct.unpack("<HQ", body[1:11])
    return time_us, body[0] - 48, tag, body[11 : 11 + TEXT_BYTES]


def _dropout(body: bytes) -> Row:
    return (int.from_bytes(body, "little"),)


def _keyed(body: bytes) -> tuple[bytes, bytes, bytes]:
    """Return type, name and value of a message ``length type name value``."""
    end = 1 + body[0]
    kind, _, name = body[1:end].partition(b" ")
    return kind, name, body[end:]


READERS: Final = {
    ord("P"): _MessageParser("parameter", PARAMETER, parameter),
    ord("I"): _MessageParser("info", INFO, _info),
    ord("L"): _MessageParser("logged_string", STRING, _string),
    ord("C"): _MessageParser("logged_string", STRING, _tagged_string),
    ord("O"): _MessageParser("dropout", DROPOUT, _dropout),
}
"""By kind. Defaults of parameters (Q), and information in many parts (M), are passed over."""


@dataclass(slots=True)
class Unpacker:
    """Converts batches in stream order to tables.

    Attributes
    ----------
    wanted
        Names of the wanted tables; all if None.
    vehicle
        Id of the vehicle.
    offset_us
        Offset that is added to times, microseconds.
    others
        Number of messages other than data, by table.
    """

    wanted: frozenset[str] | None
    vehicle: int = 1
    offset_us: int = 0
    others: dict[str, int] = field(default_factory=dict)
    _frames: int = 0
    _definitions: DefinitionTable = field(default_factory=lambda: DefinitionTable(counts_undefined=True))

    def tables(self, batch: RecordBatch, layouts: list[Layout]) -> Iterator[Table]:
        """Yield the tables of a batch."""
        yield from self._other_tables(batch)
        for layout in layouts[len(self._definitions) :]:
            self._definitions.add(layout.name, layout.wire)
        context = RowContext(self._frames, self.offset_us, self.vehicle)
        yield from self._definitions.gather(batch, self.wanted, context).tables.values()
        self._frames += batch.rows.size

    def _other_tables(self, batch: RecordBatch) -> Iterator[Table]:
        """Yield parameters, texts, information and dropouts."""
        found: dict[str, list[tuple[int, tuple[object, ...]]]] = {}
        for k in np.flatnonzero(batch.rows["kind"] != _DATA).tolist():
            reader = READERS.get(int(batch.rows["kind"][k]))
            if reader is not None:
                self.others[reader.table] = self.others.get(reader.table, 0) + 1
                wanted = self.wanted is None or reader.table in self.wanted
                said = reader.read(batch.payload(batch.rows[k])) if wanted else None
                if said is not None:
                    found.setdefault(reader.table, []).append((k, said))
        for reader in READERS.values():
            if reader.table in found:
                places, said_rows = zip(*found.pop(reader.table), strict=True)
                rows = batch.rows[list(places)]
                fields = np.array(list(said_rows), dtype=reader.wire)
                frame = np.array(places, dtype=np.int64) + self._frames
                vehicle, zeros = np.full(rows.size, self.vehicle, np.uint8), np.zeros(rows.size, np.uint8)
                time_us = rows["time_us"] + self.offset_us
                yield Table(reader.table, frame, time_us, vehicle, zeros, zeros, zeros, fields)
