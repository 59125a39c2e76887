"""Decoder of DataFlash logs: converts blocks of bytes to tables of messages."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Final

import numpy as np

from mavhums.core.arrays import Integers
from mavhums.log.base.decoder import ODD_TIME, Losses, Table, join_tables
from mavhums.log.base.scanner import RecordBatch, is_date
from mavhums.log.dataflash.layout import RecordDefinitions
from mavhums.log.dataflash.scanner import RecordScanner

DATING_MESSAGES: Final = frozenset({"PARM", "GPS"})
"""Messages with the vehicle's id and the date."""

_IDS: Final = (b"SYSID_THISMAV", b"MAV_SYSID")
_HELD: Final = 1 << 20  # bytes that wait for the vehicle's id and a fix, so that memory is bounded
_FIX: Final = 3
_WEEK_US: Final = 7 * 86_400 * 1_000_000


def _us(year: int, month: int, day: int) -> int:
    return round(datetime(year, month, day, tzinfo=UTC).timestamp()) * 1_000_000


_GPS_EPOCH_US: Final = _us(1980, 1, 6)
_LEAP_SECONDS: Final = (
    (_us(2017, 1, 1), 18),
    (_us(2015, 7, 1), 17),
    (_us(2012, 7, 1), 16),
)
"""Seconds by which GPS time was ahead of UTC from a day on (IERS Bulletin C)."""


class Dating:
    """One log of a stream: the vehicle and the UTC offset that it reports, and its times.

    Parameters
    ----------
    start
        Offset at which the log begins in the stream.

    Attributes
    ----------
    vehicle
        Id of the vehicle, 1 if the log does not report it.
    offset_us
        UTC at boot, microseconds; None if the log does not report it.
    end
        Offset in the stream from which on records are ignored.
    first_us
        Its first time, since boot, microseconds; None before it.
    shift_us
        What is added to its times, microseconds; None before its first table.
    dropped
        Records that its logger reports as dropped.
    """

    def __init__(self, start: int) -> None:
        self.vehicle = 1
        self.offset_us: int | None = None
        self._identified = False
        self.end = start + _HELD
        self.first_us: int | None = None
        self.shift_us: int | None = None
        self.dropped = 0

    def observe(self, tables: Mapping[str, Table]) -> None:
        """Process the records before ``end``."""
        parameters, positions = tables.get("PARM"), tables.get("GPS")
        if parameters is not None and not self._identified and parameters.holds_text("Name"):
            ids = np.isin(parameters["Name"], _IDS)
            for value in parameters.numbers("Value")[ids].tolist():
                if not self._identified and 1 <= value <= 255:
                    self.vehicle, self._identified = int(value), True
        if positions is not None and self.offset_us is None:
            self._date(positions)

    def is_settled(self, position: int) -> bool:
        """Return whether the result is final at ``position`` of the stream."""
        return (self._identified and self.offset_us is not None) or position >= self.end

    def _date(self, positions: Table) -> None:
        status, weeks, ms, boot_us = map(positions.numbers, ("Status", "GWk", "GMS", "TimeUS"))
        utc_us = _GPS_EPOCH_US + weeks * _WEEK_US + ms * 1000
        good = (status >= _FIX) & is_date(utc_us) & (boot_us <= utc_us)
        good &= positions.flags & ODD_TIME == 0
        for first in np.flatnonzero(good)[:1].tolist():
            ahead_s = next((seconds for since, seconds in _LEAP_SECONDS if utc_us[first] >= since), 15)
            self.offset_us = int(utc_us[first] - boot_us[first]) - ahead_s * 1_000_000


_PIECE: Final = 1 << 16  # bytes: below, the Python around a scan takes longer than the scan
_DROPS: Final = frozenset({"DSF"})


class DataFlashDecoder:
    """Incremental decoder of ArduPilot's on-board logs, in memory that does not grow with them.

    A file may hold several logs, one after the other, and a log several flights. Messages and fields
    keep their names in the log; ``system`` is the id of the vehicle on MAVLink, so
    that the telemetry log of the same flight can be matched. Times are UTC by the first valid GPS
    time; a log without any is undated.

    Parameters
    ----------
    messages
        Names of the wanted message types; all if None.

    Attributes
    ----------
    undated
        Whether the log has no GPS time, so that times count from the vehicle's boot.

    Examples
    --------
    >>> DataFlashDecoder().feed(b"not a log", final=True)
    {}
    """

    ahead_us = 0
    format = "dataflash"

    def __init__(self, messages: Iterable[str] | None = None) -> None:
        self._messages = None if messages is None else frozenset(messages)
        self._gathered = None if self._messages is None else self._messages | _DROPS
        self._scanner = RecordScanner()
        self._definitions = RecordDefinitions()
        self._datings: dict[int, Dating] = {0: Dating(0)}
        self._pending: deque[RecordBatch] = deque()
        self._held: list[bytes] = []
        self._counts: dict[int, Integers] = {}
        self._frames = 0
        self._span: tuple[int, int] | None = None
        self.undated = False

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (vehicle, 0, name), wanted or not."""
        out: Counter[tuple[int, int, str]] = Counter()
        for vehicle, counts in self._counts.items():
            for k in np.flatnonzero(counts).tolist():
                name = self._definitions.name(k)
                if name is not None:
                    out[vehicle, 0, name] += int(counts[k])
        return dict(out)

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Ids of the vehicles, increasing."""
        return tuple(sorted(self._counts))

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records by type whose definition cannot be used."""
        out: Counter[int] = Counter()
        for counts in self._counts.values():
            for k in np.flatnonzero(counts).tolist():
                if self._definitions.name(k) is None:
                    out[self._definitions.numbers[k]] += int(counts[k])
        return dict(out)

    @property
    def first_time_us(self) -> int | None:
        """Time of the first record, microseconds of UTC; None before it."""
        return self._span[0] if self._span else None

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest record, microseconds of UTC; None before the first."""
        return self._span[1] if self._span else None

    @property
    def losses(self) -> Losses:
        """Losses so far: unreadable data, and records that the logger reports as dropped."""
        dropped = sum(dating.dropped for dating in self._datings.values())
        return self._scanner.losses(unknown_frames=sum(self.unknown.values()), logger_dropped=dropped)

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        self._held.append(block)
        if self._pending and not final and sum(map(len, self._held)) < _PIECE:
            return {}  # no output yet, and small pieces would be inefficient
        batch = self._scanner.feed(b"".join(self._held), final=final)
        self._held.clear()
        self._definitions.learn(self._scanner.bodies)
        for part in _by_boot(batch):
            start, times = int(part.rows["offset"][0]), part.rows["time_us"]
            dating = self._datings.setdefault(_boot_of(part), Dating(start))
            if dating.first_us is None and times[-1] >= 0:
                dating.first_us = int(times[times >= 0][0])
            if not dating.is_settled(start):
                before_end = replace(part, rows=part.rows[part.rows["offset"] < dating.end])
                dating.observe(self._definitions.gather(before_end, DATING_MESSAGES).tables)
            self._pending.append(part)
        return join_tables([table for tables in self._final_tables(final=final) for table in tables])

    def _final_tables(self, *, final: bool) -> Iterator[list[Table]]:
        """Yield the tables of the parts whose vehicle and date are final."""
        while self._pending:
            boot = _boot_of(self._pending[0])
            dating = self._datings[boot]
            followed = _boot_of(self._pending[-1]) > boot  # of a log that has ended nothing more comes
            if not (final or followed or dating.is_settled(self._scanner.position)):
                return
            yield self._tables(dating, self._pending.popleft())

    def _tables(self, dating: Dating, part: RecordBatch) -> list[Table]:
        vehicle, shift, first = dating.vehicle, self._shift_of(dating), dating.first_us or 0
        times = part.rows["time_us"]
        if times[0] < 0:  # records before the log's first time, as its definitions, have this one
            times[times < 0] = first
        found = self._definitions.gather(
            part, self._gathered, ordinal=self._frames, shift_us=shift, vehicle=vehicle
        )
        counts = found.counts.copy()
        before = self._counts.get(vehicle, counts[:0])
        counts[: before.size] += before
        self._counts[vehicle] = counts
        self._frames += int(found.counts[self._definitions.known[:-1]].sum())
        if dating.first_us is not None:
            last = max(first, int(times.max())) + shift
            begun, ended = self._span or (first + shift, last)
            self._span = begun, max(last, ended)
        drops = found.tables.get("DSF")
        if drops is not None and drops.holds({"Dp": 1}):
            dating.dropped = max(dating.dropped, int(np.nanmax(drops.numbers("Dp"), initial=0)))
        return [t for name, t in found.tables.items() if self._messages is None or name in self._messages]

    def _shift_of(self, dating: Dating) -> int:
        """Return the time offset of a log; an undated log continues where the previous one ended."""
        if dating.shift_us is None:
            offset = dating.offset_us
            if all(other.shift_us is None for other in self._datings.values()):
                self.undated = offset is None
                dating.shift_us = offset or 0
            elif offset is None or self.undated:
                dating.shift_us = (self._span[1] if self._span else 0) - (dating.first_us or 0)
            else:
                dating.shift_us = offset
        return dating.shift_us


def _boot_of(part: RecordBatch) -> int:
    """Return the log of the stream to which a part of a batch belongs."""
    return int(part.rows["number"][0])


def _by_boot(batch: RecordBatch) -> Iterator[RecordBatch]:
    """Yield the parts of a batch that belong to one log each."""
    if not batch.rows.size:
        return
    boots = batch.rows["number"]
    first, last = int(boots[0]), int(boots[-1])
    for rows in np.split(batch.rows, np.searchsorted(boots, np.arange(first + 1, last + 1))):
        if rows.size:
            yield replace(batch, rows=rows)
