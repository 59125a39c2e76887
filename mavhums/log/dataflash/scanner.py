"""Scanner that finds the records in a DataFlash log, and reports the unreadable parts.

Results do not depend on where a block of bytes ends: an unfinished record waits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log.dataflash import _kernel
from mavhums.log.dataflash._gather import SPARE
from mavhums.log.dataflash._layout import BODY, DEFINITIONS, FMT, FMT_SIZE, TYPE
from mavhums.log.dataflash.definitions import FMT_BODY
from mavhums.log.words import GUARD

__all__ = ["Batch", "RecordScanner", "Totals"]

_LONGEST_RECORD = 255
_SHORTEST_RECORD = 4
_FILLER = 16
_REGIONS_KEPT = 1000


class Totals(NamedTuple):
    """Counts of a scan so far; bytes and records.

    ``skipped`` and ``regions`` are damage between records, ``cut_end`` an unfinished last record,
    ``filler`` equal bytes after the last record, ``old`` the records of old clusters.
    """

    skipped: int
    regions: int
    cut_end: int
    filler: int
    old: int
    odd_times: int
    jumps: int
    rewinds: int


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """The scanned buffer, and the records that a block completed, as ``_kernel.ROW``."""

    data: NDArray[np.uint8]
    base: int
    rows: NDArray[np.void]


class RecordScanner:
    """Incremental scanner of blocks of any size.

    Attributes
    ----------
    bodies
        Payloads of the FMT records that defined something, shape (definitions, 86).
    regions
        Offset and size of the first thousand damaged regions.
    """

    def __init__(self) -> None:
        self.regions: list[tuple[int, int]] = []
        self._types = np.zeros(256, dtype=TYPE)
        self._types[FMT] = (FMT_SIZE, 0, 0, 0)
        self._bodies = np.zeros((DEFINITIONS, BODY), dtype=np.uint8)
        self._bodies[0] = np.frombuffer(FMT_BODY, dtype=np.uint8)
        self._carried = np.zeros(1, dtype=_kernel.STATE)
        self._carried["time_us"] = self._carried["old_from"] = -1
        self._carried["definitions"] = 1
        self._rows = np.empty(0, dtype=_kernel.ROW)
        self._ended = np.empty(0, dtype=_kernel.REGION)
        self._rest = bytes(GUARD)
        self._skipped = self._count = 0
        self._cut = self._filler = 0

    @property
    def bodies(self) -> NDArray[np.uint8]:
        """Payloads of the FMT records that defined something."""
        return self._bodies[: int(self._carried["definitions"][0])]

    def feed(self, block: bytes, *, final: bool = False) -> Batch:
        """Return the records that ``block`` completes; ``final`` says that nothing follows."""
        joined = b"".join((self._rest, block, bytes(SPARE)))
        data = np.frombuffer(joined, dtype=np.uint8)
        size = data.size - SPARE
        most = (size - GUARD) // _SHORTEST_RECORD + 1
        if self._rows.size < most:
            self._rows = np.empty(most, dtype=_kernel.ROW)
            self._ended = np.empty(most + 1, dtype=_kernel.REGION)
        base = int(self._carried["base"][0])
        found, ended = _kernel.scan(
            data, size, final, self._carried, self._types, self._bodies, self._rows, self._ended
        )
        self._keep(self._ended[:ended])
        position = int(self._carried["position"][0])
        self._rest = joined[position - GUARD : size]
        self._carried["base"] += position - GUARD
        if final:
            self._finish()
        return Batch(data, base, self._rows[:found].copy())

    @property
    def position(self) -> int:
        """Number of bytes of the stream that are fully processed."""
        return int(self._carried["base"][0])

    @property
    def totals(self) -> Totals:
        """Counts of skipped bytes and irregular records so far."""
        state = self._carried[0]
        waiting = int(state["skipped"])
        return Totals(
            self._skipped + waiting,
            self._count + bool(waiting),
            self._cut,
            self._filler,
            int(state["old_records"]),
            int(state["odd_times"]),
            int(state["jumps"]),
            int(state["rewinds"]),
        )

    def _keep(self, regions: NDArray[np.void]) -> None:
        self._skipped += int(regions["size"].sum())
        self._count += regions.size
        room = _REGIONS_KEPT - len(self.regions)
        self.regions += [(int(offset), int(size)) for offset, size in regions[:room]]

    def _finish(self) -> None:
        """Classify the bytes after the last record: filler, a cut record, or (if too long) damage."""
        state = self._carried[0]
        self._filler = int(state["fill"]) if state["fill"] >= _FILLER else 0
        rest = int(state["skipped"]) - self._filler
        state["skipped"] = 0
        if rest > _LONGEST_RECORD:
            place = int(state["base"]) - rest - self._filler
            self._keep(np.array([(place, rest)], dtype=_kernel.REGION))
        else:
            self._cut = rest
