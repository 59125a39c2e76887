"""Decoder of PX4's ULog: converts blocks of bytes to tables of topics."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np

from mavhums.core.arrays import Integers
from mavhums.log.base.decoder import Losses, join_tables
from mavhums.log.base.scanner import RecordBatch
from mavhums.log.base.tables import Table
from mavhums.log.ulog.layouts import Layout
from mavhums.log.ulog.messages import Unpacker, parameter
from mavhums.log.ulog.scanner import UlogScanner

__all__ = ["UlogDecoder"]

_INSTANCES = 256
_HELD_BYTES = 1 << 20  # bytes that may wait for a fix; without one in them the log has no date
_DATA, _PARAMETER = b"DP"
_VEHICLE: Final = b"MAV_SYS_ID"
_GPS: Final = "vehicle_gps_position"
_YEAR_2010_US, _YEAR_2100_US = 1_262_304_000_000_000, 4_102_444_800_000_000
_FIX_3D = 3


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

    Examples
    --------
    >>> UlogDecoder().feed(b"ULog", final=True)
    {}
    """

    format = "ulog"

    def __init__(self, messages: Collection[str] | None = None) -> None:
        self._scanner = UlogScanner()
        self._unpacker = Unpacker(None if messages is None else frozenset(messages))
        self._dated = self._settled = False
        self._held: list[RecordBatch] = []
        self._first_us: int | None = None
        self._last_us: int | None = None
        self._counts: Integers = np.zeros((0, _INSTANCES), dtype=np.int64)

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (vehicle, multi id, name), wanted or not."""
        vehicle = self._unpacker.vehicle
        counts = {(vehicle, 0, name): n for name, n in self._unpacker.others.items()}
        for layout, instance in zip(*(axis.tolist() for axis in np.nonzero(self._counts)), strict=True):
            name = self._scanner.topics.layouts[layout].name
            counts[vehicle, instance, name] = int(self._counts[layout, instance])
        return counts

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Id of the vehicle, ``MAV_SYS_ID``; none before the first data."""
        return (self._unpacker.vehicle,) if self._counts.any() else ()

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records by message id without a layout; -1 stands for messages of unknown kinds."""
        kinds = self._scanner.totals.unknown
        return self._scanner.topics.unknown | ({-1: kinds} if kinds else {})

    @property
    def losses(self) -> Losses:
        """Losses so far: unreadable data, and the number of pauses of the logger."""
        pauses = self._unpacker.others.get("dropout", 0)
        return self._scanner.losses(unknown_frames=sum(self.unknown.values()), logger_dropped=pauses)

    @property
    def first_time_us(self) -> int | None:
        """Time of the first data, microseconds of UTC; None before it."""
        return None if self._first_us is None else self._first_us + self._unpacker.offset_us

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest data, microseconds of UTC; None before the first."""
        return None if self._last_us is None else self._last_us + self._unpacker.offset_us

    @property
    def undated(self) -> bool:
        """Whether the log has no satellite time, so that times count from the vehicle's boot."""
        return not self._dated

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        parts: list[Table] = []
        for batch in self._scanner.feed(block, final=final):
            if not self._settled:
                self._settle(batch)
            self._account(batch)
            if self._settled:
                parts += self._unpack([*self._held, batch])
                self._held.clear()
            elif batch.rows.size:
                self._held.append(batch)
        if final:
            self._settled = True
            parts += self._unpack(self._held)
            self._held.clear()
        return join_tables(parts)

    def _unpack(self, batches: Iterable[RecordBatch]) -> list[Table]:
        layouts = self._scanner.topics.layouts
        return [table for batch in batches for table in self._unpacker.tables(batch, layouts)]

    def _account(self, batch: RecordBatch) -> None:
        missing = len(self._scanner.topics.layouts) - len(self._counts)
        if missing:
            self._counts = np.vstack([self._counts, np.zeros((missing, _INSTANCES), dtype=np.int64)])
        records = batch.rows[batch.rows["definition"] >= 0]
        places = records["definition"].astype(np.int64) * _INSTANCES + records["component"]
        self._counts += np.bincount(places, minlength=self._counts.size).reshape(self._counts.shape)
        if self._first_us is None:
            data = np.flatnonzero((batch.rows["kind"] == _DATA) & (batch.rows["flags"] == 0))
            self._first_us = int(batch.rows["time_us"][data[0]]) if data.size else None
        if self._first_us is not None and batch.rows.size:
            latest_us = int(batch.rows["time_us"].max())
            self._last_us = max(self._last_us or self._first_us, latest_us)

    def _settle(self, batch: RecordBatch) -> None:
        """Process the vehicle's id before its first data, and the first fix in the first megabyte."""
        rows = batch.rows
        if self._first_us is None:
            before_data = np.cumsum(rows["kind"] == _DATA) == 0
            for row in rows[before_data & (rows["kind"] == _PARAMETER)]:
                said = parameter(batch.payload(row))
                if said is not None and said[0] == _VEHICLE and said[1] == b"int32_t":
                    self._unpacker.vehicle = int(said[2]) & 0xFF
        for k, layout in enumerate(self._scanner.topics.layouts):
            if layout.name == _GPS and layout.stamp >= 0 and layout.has("time_utc_usec", "u8"):
                there = (rows["definition"] == k) & (rows["offset"] < _HELD_BYTES) & (rows["flags"] == 0)
                for row in rows[there]:
                    offset_us = _utc_offset(layout, batch.payload(row))
                    if offset_us is not None:
                        self._unpacker.offset_us, self._dated, self._settled = offset_us, True, True
                        return
        # Not the end of the block: a record that it cuts may still be a fix within the megabyte.
        self._settled = self._scanner.position >= _HELD_BYTES


def _utc_offset(layout: Layout, body: bytes) -> int | None:
    """Return the offset from boot time to UTC by a fix, microseconds; None if it is not a valid 3-D fix."""
    fix = np.frombuffer(body, dtype=layout.wire, count=1)[0]
    utc_us = int(fix["time_utc_usec"])
    if layout.has("fix_type", "u1") and fix["fix_type"] < _FIX_3D:
        return None
    return utc_us - int(fix["timestamp"]) if _YEAR_2010_US < utc_us < _YEAR_2100_US else None
