"""Scanner that finds the records in a DataFlash log, and reports the unreadable parts.

Results do not depend on where a block of bytes ends: an unfinished record waits.
"""

from __future__ import annotations

import numpy as np

from mavhums.core.arrays import Bytes
from mavhums.log.base.scanner import Batch, BlockScanner
from mavhums.log.base.unaligned_io import GUARD, SPARE
from mavhums.log.dataflash.definitions import FMT_BODY
from mavhums.log.dataflash.layout import BODY, DEFINITIONS, FMT, FMT_SIZE, TYPE
from mavhums.log.dataflash.scan import ROW, STATE, scan

__all__ = ["RecordScanner"]

_LONGEST_RECORD = 255
_SHORTEST_RECORD = 4


class RecordScanner(BlockScanner):
    """Incremental scanner of blocks of any size."""

    def __init__(self) -> None:
        super().__init__(ROW, STATE, shortest=_SHORTEST_RECORD)
        self._types = np.zeros(256, dtype=TYPE)
        self._types[FMT] = (FMT_SIZE, 0, 0, 0)
        self._bodies = np.zeros((DEFINITIONS, BODY), dtype=np.uint8)
        self._bodies[0] = np.frombuffer(FMT_BODY, dtype=np.uint8)
        self._carried["time_us"] = self._carried["old_from"] = -1
        self._carried["definitions"] = 1

    @property
    def bodies(self) -> Bytes:
        """Payloads of the FMT records that defined something, shape (definitions, 86)."""
        return self._bodies[: int(self._carried["definitions"][0])]

    def feed(self, block: bytes, *, final: bool = False) -> Batch:
        """Return the records that ``block`` completes; ``final`` says that nothing follows."""
        joined = self._joined(block)
        data = np.frombuffer(joined, dtype=np.uint8)
        base = self.position
        found, ended = scan(
            data,
            data.size - SPARE,
            final,
            self._carried,
            self._types,
            self._bodies,
            self._rows,
            self._damaged,
        )
        self._add_damage(self._damaged[:ended])
        position = int(self._carried["position"][0])
        self._carry(joined, position)
        self._carried["base"] += position - GUARD
        if final:
            self._finish(longest=_LONGEST_RECORD)
        # A copy: records wait for the flight's date while the next blocks are scanned.
        return Batch(data, base, self._rows[:found].copy())
