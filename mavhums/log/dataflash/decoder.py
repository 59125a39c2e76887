"""Decoder of DataFlash logs: converts blocks of bytes to tables of messages."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log.dataflash._columns import Lexicon, Placed
from mavhums.log.dataflash.dating import NEEDED, Dating
from mavhums.log.dataflash.scanner import Batch, RecordScanner
from mavhums.log.losses import Losses, Region
from mavhums.log.tables import Table

__all__ = ["DataFlashDecoder"]

_REGIONS_TOLD: Final = 100
_PIECE: Final = 1 << 16
_DROPS: Final = frozenset({"DSF"})


class _Part(NamedTuple):
    """The records of one log of the stream within one batch."""

    batch: Batch
    rows: NDArray[np.void]
    boot: int


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

    Examples
    --------
    >>> DataFlashDecoder().feed(b"not a log", final=True)
    {}
    """

    def __init__(self, messages: Iterable[str] | None = None) -> None:
        self._messages = None if messages is None else frozenset(messages)
        self._gathered = None if self._messages is None else self._messages | _DROPS
        self._scanner = RecordScanner()
        self._lexicon = Lexicon()
        self._datings: dict[int, Dating] = {0: Dating(0)}
        self._pending: deque[_Part] = deque()
        self._held: list[bytes] = []
        self._counts: dict[int, NDArray[np.int64]] = {}
        self._frames = 0
        self._span: tuple[int, int] | None = None
        self._firsts: dict[int, int] = {}
        self._shift: dict[int, int] = {}
        self._undated = False
        self._dropped: dict[int, int] = {}

    @property
    def format(self) -> str:
        """Name of the format."""
        return "dataflash"

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (vehicle, 0, name), wanted or not."""
        out: Counter[tuple[int, int, str]] = Counter()
        for vehicle, counts in self._counts.items():
            for k in np.flatnonzero(counts).tolist():
                definition = self._lexicon.definitions[k]
                if definition is not None:
                    out[vehicle, 0, definition.name] += int(counts[k])
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
                if self._lexicon.definitions[k] is None:
                    out[self._lexicon.numbers[k]] += int(counts[k])
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
    def undated(self) -> bool:
        """Whether the log has no GPS time, so that times count from the vehicle's boot."""
        return self._undated

    @property
    def losses(self) -> Losses:
        """Losses so far: unreadable data, and records that the logger reports as dropped."""
        totals = self._scanner.totals
        return Losses(
            bytes_skipped=totals.skipped,
            damaged_regions=totals.regions,
            unknown_frames=sum(self.unknown.values()),
            implausible_times=totals.odd_times,
            cut_end_bytes=totals.cut_end,
            regions=tuple(Region(offset=o, size=n) for o, n in self._scanner.regions[:_REGIONS_TOLD]),
            trailing_zeros=totals.filler,
            time_jumps=totals.jumps,
            time_rewinds=totals.rewinds,
            logger_dropped=sum(self._dropped.values()),
        )

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        self._held.append(block)
        if self._pending and not final and sum(map(len, self._held)) < _PIECE:
            return {}  # no output yet, and small pieces would be inefficient
        batch = self._scanner.feed(b"".join(self._held), final=final)
        self._held.clear()
        self._lexicon.learn(self._scanner.bodies)
        for part in _by_boot(batch):
            if part.boot not in self._datings:
                self._datings[part.boot] = Dating(int(part.rows["offset"][0]))
            times = part.rows["time_us"]
            if part.boot not in self._firsts and times[-1] >= 0:
                self._firsts[part.boot] = int(times[times >= 0][0])
            self._listen(part)
            self._pending.append(part)
        parts: dict[str, list[Table]] = {}
        for tables in self._settled(final=final):
            for name, table in tables.items():
                parts.setdefault(name, []).append(table)
        return {name: Table.concatenate(tables) for name, tables in parts.items()}

    def _listen(self, part: _Part) -> None:
        dating = self._datings[part.boot]
        if not dating.is_settled(int(part.rows["offset"][0])):
            rows = part.rows[part.rows["offset"] < dating.end]
            dating.listen(self._lexicon.tables(part.batch, rows, NEEDED).tables)

    def _settled(self, *, final: bool) -> Iterator[dict[str, Table]]:
        """Yield the tables of the parts whose vehicle and date are final."""
        while self._pending:
            part = self._pending[0]
            followed = self._pending[-1].boot > part.boot
            if not (final or followed or self._datings[part.boot].is_settled(self._scanner.position)):
                return
            yield self._tables(self._pending.popleft())

    def _tables(self, part: _Part) -> dict[str, Table]:
        vehicle, shift = self._datings[part.boot].vehicle, self._shift_of(part.boot)
        placed = Placed(vehicle, self._frames, self._firsts.get(part.boot, 0), shift)
        found = self._lexicon.tables(part.batch, part.rows, self._gathered, placed)
        counts = found.counts.copy()
        before = self._counts.get(vehicle, counts[:0])
        counts[: before.size] += before
        self._counts[vehicle] = counts
        self._frames += int(found.counts[self._lexicon.known].sum())
        if part.boot in self._firsts:
            first, last = self._firsts[part.boot] + shift, int(part.rows["time_us"].max()) + shift
            begun = first if self._span is None else self._span[0]
            self._span = begun, max(first, last, self._span[1] if self._span else first)
        self._note_drops(part.boot, found.tables.get("DSF"))
        if self._messages is None:
            return found.tables
        return {name: table for name, table in found.tables.items() if name in self._messages}

    def _shift_of(self, boot: int) -> int:
        """Return the time offset of a log; an undated log continues where the previous one ended."""
        if boot not in self._shift:
            offset = self._datings[boot].offset_us
            if not self._shift:
                self._undated = offset is None
                self._shift[boot] = offset or 0
            elif offset is None or self._undated:
                self._shift[boot] = (self._span[1] if self._span else 0) - self._firsts.get(boot, 0)
            else:
                self._shift[boot] = offset
        return self._shift[boot]

    def _note_drops(self, boot: int, table: Table | None) -> None:
        if table is not None and "Dp" in (table.fields.dtype.names or ()):
            self._dropped[boot] = max(self._dropped.get(boot, 0), int(table["Dp"].max()))


def _by_boot(batch: Batch) -> Iterator[_Part]:
    """Yield the rows of a batch, divided by log."""
    rows = batch.rows
    if not rows.size:
        return
    first, last = int(rows["boot"][0]), int(rows["boot"][-1])
    edges = np.searchsorted(rows["boot"], np.arange(first, last + 2))
    for k, boot in enumerate(range(first, last + 1)):
        if edges[k] < edges[k + 1]:
            yield _Part(batch, rows[edges[k] : edges[k + 1]], boot)
