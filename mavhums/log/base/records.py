"""Gathers the rows of a scan into one table per definition: a counting sort and a copy."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Bytes, Bytes1, Bytes2, Flags, Flags1, Integers, Integers1
from mavhums.core.kernels import inlined, kernel, load_word, store_word
from mavhums.log.base.decoder import Table
from mavhums.log.base.scanner import GUARD, SPARE, RecordBatch, Rows


class GatheredTables(NamedTuple):
    """Tables by name, and the number of rows of each definition, wanted or not, shape (definitions,)."""

    tables: dict[str, Table]
    counts: Integers


class Definition(NamedTuple):
    """Definition of a message.

    Attributes
    ----------
    name
        Name of the message.
    wire
        Layout of the payload.
    divisors
        Divisor of a field's raw number, where the format defines one.
    """

    name: str
    wire: np.dtype[np.void]
    divisors: Mapping[str, float] = MappingProxyType({})


class DefinitionTable:
    """The definitions of a log's messages by number, and the conversion of rows to tables.

    Parameters
    ----------
    counts_undefined
        Whether a record without a definition has a place in a table's ``frame``.
    """

    def __init__(self, *, counts_undefined: bool = False) -> None:
        self._counts_undefined = counts_undefined
        self._known = np.empty(0, dtype=np.bool_)
        self._definitions: list[Definition | None] = []
        self._sizes: dict[Collection[str] | None, Integers] = {}

    def __len__(self) -> int:
        return len(self._definitions)

    def name(self, number: int) -> str | None:
        """Return the name of a definition; None if it cannot be used."""
        definition = self._definitions[number]
        return None if definition is None else definition.name

    def add(self, definition: Definition | None) -> None:
        """Add the next definition; None if it cannot be used: its records are unknown then."""
        self._definitions.append(definition)
        self._sizes.clear()

    @property
    def known(self) -> Flags:
        """Whether the records of each definition count; last, whether those without one do."""
        if self._known.size <= len(self._definitions):
            defined = [definition is not None for definition in self._definitions]
            self._known = np.array([*defined, self._counts_undefined])
        return self._known

    def gather(
        self,
        batch: RecordBatch,
        messages: frozenset[str] | None,
        *,
        ordinal: int = 0,
        shift_us: int = 0,
        vehicle: int | None = None,
    ) -> GatheredTables:
        """Return the wanted messages of a batch; all if ``messages`` is None.

        Parameters
        ----------
        ordinal
            Number of counted records before them.
        shift_us
            Offset added to their times.
        vehicle
            Id of the vehicle; None where the rows contain it.
        """
        sizes = self._wanted(messages)
        counts = _count(batch.rows, sizes.size)
        wanted = np.where(sizes > 0, counts, 0)
        row_ends, byte_ends = np.cumsum(wanted), np.cumsum(wanted * sizes + SPARE)
        begin, first_byte = row_ends - wanted, byte_ends - (wanted * sizes + SPARE)
        total = int(row_ends[-1])
        frame, time_us = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
        header = np.empty((4, total), dtype=np.uint8)
        payloads = np.empty(int(byte_ends[-1]), dtype=np.uint8)
        _gather(
            batch.data, batch.base, batch.rows, ordinal, shift_us, sizes, self.known,
            begin.copy(), first_byte.copy(), frame, time_us, header, payloads,
        )  # fmt: skip
        if vehicle is not None:
            header[0] = vehicle
        tables: dict[str, Table] = {}
        for k in np.flatnonzero(wanted).tolist():
            definition = self._definitions[k]
            assert definition is not None
            rows = slice(begin[k], row_ends[k])
            fields = payloads[first_byte[k] : byte_ends[k] - SPARE].view(definition.wire)
            system, component, sequence, flags = header[:, rows]
            table = Table(
                definition.name, frame[rows], time_us[rows], system, component, sequence, flags, fields,
                definition.divisors,
            )  # fmt: skip
            before = tables.get(definition.name)
            tables[definition.name] = table if before is None else _merged(before, table)
        return GatheredTables(tables, counts[:-1])

    def _wanted(self, messages: frozenset[str] | None) -> Integers:
        """Return the bytes of a payload by definition, 0 if it is not wanted; last, 0 for no definition."""
        if messages not in self._sizes:
            sizes = [
                d.wire.itemsize if d is not None and (messages is None or d.name in messages) else 0
                for d in self._definitions
            ]
            self._sizes[messages] = np.array([*sizes, 0], dtype=np.int64)
        return self._sizes[messages]


def _merged(first: Table, second: Table) -> Table:
    """Join the messages of two definitions with one name and layout."""
    both = Table.concatenate([first, second])
    return both.select(np.argsort(both.frame, kind="stable"))


@kernel
def _count(rows: Rows, places: int) -> Integers:
    """Return the number of rows of each definition, shape (places,); the last is of no definition (-1)."""
    counts = np.zeros(places, dtype=np.int64)
    for k in range(rows.size):
        counts[rows[k].definition] += 1
    return counts


@inlined
def _copy(data: Bytes, source: int, kept: int, out: Bytes, place: int, size: int) -> None:
    """Copy ``kept`` bytes and fill up to ``size`` with zeros; ``out`` has a word to spare behind it.

    Whole words are written; bytes beyond the end belong to the next record, which is written later.
    """
    # A whole payload, as every one of an on-board log, needs no look at each word: a third of the time.
    if kept == size:
        for j in range(0, size, 8):
            store_word(out, place + j, load_word(data, source + j))
        return
    for j in range(0, size, 8):
        left = kept - j
        if left >= 8:
            store_word(out, place + j, load_word(data, source + j))
        elif left > 0:
            word = load_word(data, source + kept - 8) >> np.uint64(64 - 8 * left)
            store_word(out, place + j, word)
        else:
            store_word(out, place + j, np.uint64(0))


@kernel
def _gather(
    data: Bytes1,
    base: int,
    rows: Rows,
    ordinal: int,
    shift_us: int,
    sizes: Integers1,
    known: Flags1,
    row_of: Integers1,
    byte_of: Integers1,
    frame: Integers1,
    time_us: Integers1,
    header: Bytes2,
    payloads: Bytes1,
) -> None:
    """Copy the wanted rows to columns, and restore the zeros that MAVLink's senders trim.

    Parameters
    ----------
    data, base, rows
        Those of a batch.
    ordinal, shift_us
        Those of `DefinitionTable.gather`.
    sizes, known
        By definition, last for records without one: bytes of a payload, 0 if it is not wanted; and whether
        its records count.
    row_of, byte_of
        By definition: position of its next row and payload; advanced.
    frame, time_us, header, payloads
        Output. ``header`` has shape (4, n): system, component, sequence, flags. ``SPARE`` bytes
        after each definition's payloads are overwritten.
    """
    for k in range(rows.size):
        row = rows[k]
        definition = row.definition
        size = sizes[definition]
        if size > 0:
            out = row_of[definition]
            row_of[definition] = out + 1
            frame[out] = ordinal
            time_us[out] = row.time_us + shift_us
            header[0, out] = row.system
            header[1, out] = row.component
            header[2, out] = row.sequence
            header[3, out] = row.flags
            place = byte_of[definition]
            byte_of[definition] = place + size
            source = row.offset - base + GUARD + row.start
            _copy(data, source, min(np.int64(row.length), size), payloads, place, size)
        if known[definition]:
            ordinal += 1
