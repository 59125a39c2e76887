"""Converts the messages of a batch to tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mavhums.log.flags import ODD_TIME
from mavhums.log.tables import Table
from mavhums.log.ulog._gather import SPARE, count, gather
from mavhums.log.ulog.layouts import Layout
from mavhums.log.ulog.messages import READERS
from mavhums.log.ulog.scanner import Batch

__all__ = ["INSTANCES", "Unpacker"]

INSTANCES = 256
_DATA = ord("D")


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

    wanted: Collection[str] | None
    vehicle: int = 1
    offset_us: int = 0
    others: dict[str, int] = field(default_factory=dict)
    _frames: int = 0

    def tables(self, batch: Batch, layouts: Sequence[Layout]) -> Iterator[Table]:
        """Yield the tables of a batch."""
        yield from self._said(batch)
        yield from self._data(batch, layouts)
        self._frames += batch.rows.size

    def _said(self, batch: Batch) -> Iterator[Table]:
        """Yield parameters, texts, information and dropouts."""
        found: dict[str, list[tuple[int, tuple[object, ...]]]] = {}
        for k in np.flatnonzero(batch.rows["kind"] != _DATA).tolist():
            reader = READERS.get(int(batch.rows["kind"][k]))
            if reader is not None:
                self.others[reader.table] = self.others.get(reader.table, 0) + 1
                said = reader.read(batch.body(batch.rows[k])) if self._wants(reader.table) else None
                if said is not None:
                    found.setdefault(reader.table, []).append((k, said))
        for reader in READERS.values():
            if reader.table in found:
                places, said_rows = zip(*found.pop(reader.table), strict=True)
                rows = batch.rows[list(places)]
                header = np.zeros((2, rows.size), dtype=np.uint8)
                fields = np.array(list(said_rows), dtype=reader.wire)
                frame = np.array(places, dtype=np.int64) + self._frames
                yield self._table(reader.table, frame, rows["time_us"] + self.offset_us, header, fields)

    def _data(self, batch: Batch, layouts: Sequence[Layout]) -> Iterator[Table]:
        wanted = np.array([self._wants(layout.name) for layout in layouts], dtype=bool)
        sizes = np.array([layout.wire.itemsize for layout in layouts], dtype=np.int64)
        by_instance = np.zeros((len(layouts), INSTANCES), dtype=np.int64)
        count(batch.rows, by_instance)
        counts = by_instance.sum(axis=1) * wanted
        row_of = np.cumsum(counts) - counts
        bytes_of = counts * sizes + SPARE
        byte_of = np.cumsum(bytes_of) - bytes_of
        total = int(counts.sum())
        frame, time_us = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
        header = np.empty((2, total), dtype=np.uint8)
        records = np.empty(int(bytes_of.sum()), dtype=np.uint8)
        rows, places = row_of.copy(), byte_of.copy()
        gather(
            batch.data, batch.base, batch.rows, self._frames, self.offset_us, wanted, sizes,
            rows, places, frame, time_us, header, records,
        )  # fmt: skip
        for k in np.flatnonzero(counts).tolist():
            mine = slice(row_of[k], rows[k])
            fields = records[byte_of[k] : places[k]].view(layouts[k].wire)
            yield self._table(layouts[k].name, frame[mine], time_us[mine], header[:, mine], fields)

    def _table(
        self,
        name: str,
        frame: NDArray[np.int64],
        time_us: NDArray[np.int64],
        header: NDArray[np.uint8],
        fields: NDArray[np.void],
    ) -> Table:
        instance, odd = header
        system = np.full(frame.size, self.vehicle, dtype=np.uint8)
        return Table(
            name, frame, time_us, system, instance, np.zeros_like(system), odd * np.uint8(ODD_TIME), fields
        )

    def _wants(self, name: str) -> bool:
        return self.wanted is None or name in self.wanted
