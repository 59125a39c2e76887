"""A decoder of PX4's ULog: blocks of bytes in, tables of topics out."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.assessment import Losses, Region
from mavhums.log.flags import ODD_TIME
from mavhums.log.tables import Table
from mavhums.log.ulog import _kernel
from mavhums.log.ulog._gather import SPARE, count, gather
from mavhums.log.ulog.layouts import Layout
from mavhums.log.ulog.messages import READERS
from mavhums.log.ulog.scanner import Batch, UlogScanner

__all__ = ["UlogDecoder"]

_REGIONS_TOLD = 100
_HELD = 1 << 20
_GPS: Final = "vehicle_gps_position"
_YEAR_2010_US, _YEAR_2100_US = 1_262_304_000_000_000, 4_102_444_800_000_000
_FIX_3D = 3
_INSTANCES = 256


class UlogDecoder:
    """Incremental decoder of a ULog, in memory that does not grow with it.

    Tables are named as topics are; beside them there are ``parameter``, ``logged_string``, ``info`` and
    ``dropout``. A table's component is the topic's multi id. Times are the autopilot's, since boot, put
    on UTC by the first 3-D fix in the first megabyte; what comes before it is held back until then.

    Parameters
    ----------
    messages
        Names of the tables that are wanted; all if None. Others are checked and counted but not
        unpacked.

    Examples
    --------
    >>> UlogDecoder().feed(b"ULog", final=True)
    {}
    """

    format = "ulog"

    def __init__(self, messages: Collection[str] | None = None) -> None:
        self._wanted = None if messages is None else frozenset(messages)
        self._scanner = UlogScanner()
        self._vehicle = 1
        self._offset_us: int | None = None
        self._settled = False
        self._held: list[Table] = []
        self._frames = 0
        self._first_us: int | None = None
        self._last_us: int | None = None
        self._counts: NDArray[np.int64] = np.zeros((0, _INSTANCES), dtype=np.int64)
        self._others: dict[str, int] = {}

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
        """Number of records by message id without a layout; -1 stands for messages of unknown kinds."""
        kinds = self._scanner.totals.unknown
        return self._scanner.topics.unknown | ({-1: kinds} if kinds else {})

    @property
    def losses(self) -> Losses:
        """What could not be read so far, and how often the logger paused."""
        totals = self._scanner.totals
        return Losses(
            bytes_skipped=totals.skipped,
            damaged_regions=totals.regions,
            unknown_frames=sum(self.unknown.values()),
            implausible_times=totals.odd_times,
            cut_end_bytes=totals.cut_end,
            regions=tuple(Region(offset=o, size=n) for o, n in self._scanner.regions[:_REGIONS_TOLD]),
            trailing_zeros=totals.zeros,
            time_jumps=totals.jumps,
            logger_dropped=self._others.get("dropout", 0),
        )

    @property
    def first_time_us(self) -> int | None:
        """Time of the first data, microseconds of UTC; None before it."""
        return None if self._first_us is None else self._first_us + (self._offset_us or 0)

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest data, microseconds of UTC; None before the first."""
        return None if self._last_us is None else self._last_us + (self._offset_us or 0)

    @property
    def undated(self) -> bool:
        """Whether no satellite told the date, so that times count from the vehicle's boot."""
        return self._offset_us is None

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        for batch in self._scanner.feed(block, final=final):
            self._account(batch)
            others = self._others_of(batch)
            if not self._settled:
                self._settle(batch)
            self._held += [*others, *self._data_of(batch)]
            self._frames += batch.rows.size
        if not (self._settled or final):
            return {}
        self._settled = True
        held, self._held = self._held, []
        parts: dict[str, list[Table]] = {}
        for table in held:
            parts.setdefault(table.name, []).append(self._placed(table))
        return {name: Table.concatenate(tables) for name, tables in parts.items()}

    def _account(self, batch: Batch) -> None:
        missing = len(self._scanner.topics.layouts) - len(self._counts)
        if missing:
            self._counts = np.vstack([self._counts, np.zeros((missing, _INSTANCES), dtype=np.int64)])
        count(batch.rows, self._counts)
        times = batch.rows["time_us"][batch.rows["definition"] >= 0]
        if times.size:
            if self._first_us is None:
                self._first_us = int(times[0])
            self._last_us = max(self._last_us or 0, int(times.max()))

    def _settle(self, batch: Batch) -> None:
        """Put boot time on UTC by the first fix, if there is one in the first megabyte."""
        rows = batch.rows
        for k, layout in enumerate(self._scanner.topics.layouts):
            if layout.name == _GPS and {"time_utc_usec", "timestamp"} <= set(layout.wire.names or ()):
                there = (rows["definition"] == k) & (rows["offset"] < _HELD) & (rows["odd"] == 0)
                for row in rows[there]:
                    offset_us = _utc_offset(layout, batch.body(row)[2:])
                    if offset_us is not None:
                        self._offset_us, self._settled = offset_us, True
                        return
        self._settled = batch.base + batch.data.size >= _HELD

    def _placed(self, table: Table) -> Table:
        """Return a table that was held back with the vehicle's id and times of UTC."""
        system = np.full(len(table), self._vehicle, dtype=np.uint8)
        return replace(table, system=system, time_us=table.time_us + (self._offset_us or 0))

    def _others_of(self, batch: Batch) -> list[Table]:
        """Return parameters, texts, information and dropouts, and heed the vehicle's id."""
        found: dict[str, list[tuple[int, tuple[object, ...]]]] = {}
        wires = {}
        for k in np.flatnonzero(batch.rows["definition"] < 0).tolist():
            reader = READERS.get(int(batch.rows["kind"][k]))
            if reader is None:
                continue
            self._others[reader.table] = self._others.get(reader.table, 0) + 1
            said = reader.read(batch.body(batch.rows[k]))
            if said is None:
                continue
            if reader.table == "parameter" and said[0] == "MAV_SYS_ID" and not self._settled:
                self._vehicle = int(str(said[2]).partition(".")[0]) & 0xFF
            if self._wants(reader.table):
                found.setdefault(reader.table, []).append((k, said))
                wires[reader.table] = reader.wire
        return [
            self._table(
                name, batch, np.array([k for k, _ in rows]), np.array([said for _, said in rows], wires[name])
            )
            for name, rows in found.items()
        ]

    def _data_of(self, batch: Batch) -> list[Table]:
        layouts = self._scanner.topics.layouts
        wanted = np.array([self._wants(layout.name) for layout in layouts], dtype=bool)
        sizes = np.array([layout.wire.itemsize for layout in layouts], dtype=np.int64)
        counts = np.zeros((len(layouts), _INSTANCES), dtype=np.int64)
        count(batch.rows, counts)
        per_layout = counts.sum(axis=1) * wanted
        row_of = np.cumsum(per_layout) - per_layout
        bytes_of = per_layout * sizes + SPARE
        byte_of = np.cumsum(bytes_of) - bytes_of
        source = np.empty(int(per_layout.sum()), dtype=np.int64)
        records = np.empty(int(bytes_of.sum()), dtype=np.uint8)
        rows, places = row_of.copy(), byte_of.copy()
        gather(batch.data, batch.base, batch.rows, wanted, sizes, rows, places, source, records)
        return [
            self._table(
                layouts[k].name,
                batch,
                source[row_of[k] : rows[k]],
                records[byte_of[k] : places[k]].view(layouts[k].wire),
            )
            for k in np.flatnonzero(per_layout).tolist()
        ]

    def _table(self, name: str, batch: Batch, source: NDArray[np.int64], fields: NDArray[np.void]) -> Table:
        rows = batch.rows[source]
        empty = np.zeros(source.size, dtype=np.uint8)
        return Table(
            name,
            source + self._frames,
            rows["time_us"].copy(),
            empty,
            rows["instance"].copy(),
            empty,
            rows["odd"] * np.uint8(ODD_TIME),
            fields,
        )

    def _wants(self, name: str) -> bool:
        return self._wanted is None or name in self._wanted


def _utc_offset(layout: Layout, body: bytes) -> int | None:
    """Return what a fix adds to boot time, microseconds; None if it does not tell."""
    fix = np.frombuffer(body, dtype=layout.wire, count=1)[0]
    utc_us = int(fix["time_utc_usec"])
    if "fix_type" in (layout.wire.names or ()) and fix["fix_type"] < _FIX_3D:
        return None
    return utc_us - int(fix["timestamp"]) if _YEAR_2010_US < utc_us < _YEAR_2100_US else None
