"""What all scanners share: unfinished bytes and account of damage across blocks, and the times that can be.

A log's numbers are arbitrary: every time in them passes here once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final

import numpy as np

from mavhums.core.arrays import Block, Bytes, Integers, Records
from mavhums.core.kernels import inlined
from mavhums.log.base.decoder import Losses, Region

YES, NO, WAIT = 1, 0, -1
"""A kernel's answers; ``WAIT`` means that it lies in bytes to come."""

ROW: Final = np.dtype(
    [
        ("offset", "i8"),
        ("time_us", "i8"),
        ("definition", "i4"),
        ("number", "i4"),
        ("length", "u2"),
        ("crc", "u2"),
        ("start", "u1"),
        ("system", "u1"),
        ("component", "u1"),
        ("sequence", "u1"),
        ("flags", "u1"),
    ],
    align=True,
)
"""One record of any format.

``offset`` of the record in the stream; ``definition`` its number in the `DefinitionTable`, -1 if it has none;
``start`` the bytes before its payload, and ``length`` those of the payload; ``flags`` those of a table.
``number`` is the id of a MAVLink message, the boot of a DataFlash record (how many logs began before it in
the stream), the kind of a ULog message; ``crc`` is of MAVLink alone.
"""

Rows = Annotated[Records, Block(ROW)]
Record = Any
"""An element of a structured array, within compiled code."""
REGION: Final = np.dtype([("offset", "i8"), ("size", "i8")])
Regions = Annotated[Records, Block(REGION)]


def counters(*names: str) -> np.dtype[np.void]:
    """Return the type of what a scan carries from block to block: whole numbers of these names."""
    return np.dtype([(name, "i8") for name in names])


_FILLER_BYTES = 16
"""Equal bytes at the end of a log that count as filler rather than as a cut record."""

_REGIONS_KEPT = 1000
_REGIONS_LISTED = 100
_COUNTS = ("odd_times", "jumps", "rewinds", "padded", "trials", "old_records", "unknown")


@dataclass(frozen=True, slots=True, eq=False)
class RecordBatch:
    """The records that a block completed, with fields `ROW`, and the scanned buffer.

    Attributes
    ----------
    data
        ``GUARD`` bytes, then the stream from offset ``base`` on, then ``SPARE`` bytes.
    rows
        The records.
    stamp
        Bytes of each MAVLink record before its frame.
    """

    data: Bytes
    base: int
    rows: Records
    stamp: int = 0

    @property
    def places(self) -> Integers:
        """Position of each record in ``data``, shape (n,)."""
        places: Integers = self.rows["offset"] - (self.base - GUARD)
        return places

    def payload(self, row: np.void) -> bytes:
        """Return the payload of a record."""
        begin = int(row["offset"]) - self.base + GUARD + int(row["start"])
        return self.data[begin : begin + int(row["length"])].tobytes()


@dataclass(frozen=True, slots=True)
class ScanTotals:
    """Counts of a scan so far.

    ``skipped`` bytes in ``regions`` are damage between records, ``cut_end`` an unfinished last record,
    ``filler`` equal bytes after it. ``odd_times`` are damaged time stamps, ``jumps`` and ``rewinds`` steps
    of the clock. ``padded`` and ``trials`` are of MAVLink: frames whose trimmed zeros were restored, and the
    lengths tried; ``old_records`` of DataFlash: those of old clusters; ``unknown`` of ULog: messages of
    unknown kinds.
    """

    skipped: int
    regions: int
    cut_end: int
    filler: int
    odd_times: int = 0
    jumps: int = 0
    rewinds: int = 0
    padded: int = 0
    trials: int = 0
    old_records: int = 0
    unknown: int = 0


class BlockScanner:
    """State of a scan between blocks of any size; a format adds its kernel.

    Parameters
    ----------
    state
        Type of the kernel's state. It has ``base``, the
        stream offset of the next byte to scan; ``position``, where in the buffer the kernel stopped;
        ``skipped``, the bytes since the last record; and ``filler``, the equal bytes at their end.
    shortest
        Bytes of the shortest record.

    Attributes
    ----------
    regions
        Offset and size of the first thousand damaged regions.
    """

    def __init__(self, state: np.dtype[np.void], *, shortest: int) -> None:
        self.regions: list[tuple[int, int]] = []
        self._carried: Records = np.zeros(1, dtype=state)
        self._rows: Records = np.empty(0, dtype=ROW)
        self._damaged: Records = np.empty(0, dtype=REGION)
        self._shortest = shortest
        self._rest = bytes(GUARD)
        self._skipped = self._damaged_regions = self._cut = self._filler = 0

    @property
    def position(self) -> int:
        """Number of bytes of the stream that are fully processed."""
        return int(self._carried["base"][0])

    @property
    def totals(self) -> ScanTotals:
        """Counts so far."""
        state = self._carried[0]
        waiting = int(state["skipped"])
        counts = {name: int(state[name]) for name in _COUNTS if name in (state.dtype.names or ())}
        return ScanTotals(
            self._skipped + waiting, self._damaged_regions + bool(waiting), self._cut, self._filler, **counts
        )

    def losses(self, **other: Any) -> Losses:
        """Return the losses so far, with the ``other`` fields that the format counts itself."""
        totals = self.totals
        return Losses(
            bytes_skipped=totals.skipped,
            damaged_regions=totals.regions,
            implausible_times=totals.odd_times,
            cut_end_bytes=totals.cut_end,
            regions=tuple(Region(offset=o, size=n) for o, n in self.regions[:_REGIONS_LISTED]),
            padded_frames=totals.padded,
            # A CRC of 16 bits fits one in 65,536 wrong lengths by chance.
            padded_false_bound=totals.trials / 65536,
            trailing_zeros=totals.filler,
            time_jumps=totals.jumps,
            time_rewinds=totals.rewinds,
            **other,
        )

    def _scanned(
        self, block: bytes, scan: Callable[[Bytes], tuple[int, int]], *, longest: int | None
    ) -> RecordBatch:
        """Return the records that a block completes.

        Parameters
        ----------
        scan
            Writes the rows and the damaged regions of a buffer, and returns their numbers.
        longest
            Bytes of the longest record that the end of the stream may cut; None before the end.
        """
        joined = self._joined(block)
        data, base = np.frombuffer(joined, dtype=np.uint8), self.position
        found, ended = scan(data[: data.size - SPARE])
        self._add_damage(self._damaged[:ended])
        position = int(self._carried["position"][0])
        self._carry(joined, position)
        self._carried["base"] += position - GUARD
        if longest is not None:
            self._finish(longest=longest)
        return RecordBatch(data, base, self._rows[:found])

    def _joined(self, block: bytes) -> bytes:
        """Return the guard, the unfinished bytes, the block and the spare bytes; make room for their rows."""
        joined = b"".join((self._rest, block, bytes(SPARE)))
        most = (len(joined) - GUARD - SPARE) // self._shortest + 1
        if self._rows.size < most:
            self._rows = np.empty(most, dtype=ROW)
            self._damaged = np.empty(most + 1, dtype=REGION)
        return joined

    def _carry(self, joined: bytes, position: int) -> None:
        """Keep the bytes from ``position`` on, which wait for the next block, with the guard before them."""
        self._rest = joined[position - GUARD : len(joined) - SPARE]

    def _add_damage(self, regions: Records) -> None:
        self._skipped += int(regions["size"].sum())
        self._damaged_regions += regions.size
        room = _REGIONS_KEPT - len(self.regions)
        self.regions += [(int(offset), int(size)) for offset, size in regions[:room]]

    def _finish(self, *, longest: int) -> None:
        """Classify the bytes after the last record: filler, a cut record, or damage above ``longest``."""
        state = self._carried[0]
        filler = int(state["filler"]) if state["filler"] >= _FILLER_BYTES else 0
        rest = int(state["skipped"]) - filler
        self._filler += filler
        if rest > longest:
            place = int(state["base"]) - rest - filler
            self._add_damage(np.array([(place, rest)], dtype=REGION))
        else:
            self._cut += rest
        state["skipped"] = state["filler"] = 0


GUARD = 32
"""Readable bytes before a buffer's first frame or record: MAVLink's signature and stamp, and a word."""

SPARE = 8
"""Bytes after a buffer's last record that may be read or written with it: a word."""

YEAR_2010_US: Final = 1_262_304_000_000_000
"""Before, nobody recorded these formats: a receiver whose week number rolled over, or no clock at all."""

YEAR_2100_US: Final = 4_102_444_800_000_000


@inlined
def plausible(time_us: Any) -> Any:
    """Return whether a time since boot, or since 1970, can be: it lies between 1970 and 2100."""
    return (time_us >= 0) & (time_us < YEAR_2100_US)


def is_date(utc_us: Any) -> Any:
    """Return whether a vehicle may have flown at this time, microseconds of UTC; times may be an array.

    Examples
    --------
    >>> is_date(1_700_000_000_000_000), is_date(10**18), is_date(0)
    (True, False, False)
    """
    return (utc_us > YEAR_2010_US) & (utc_us < YEAR_2100_US)
