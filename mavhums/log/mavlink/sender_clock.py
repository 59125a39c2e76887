"""Times for a log without time stamps, from the boot times that its senders report."""

from __future__ import annotations

import numpy as np

from mavhums.log.flags import MAVLINK1
from mavhums.log.mavlink.dialect import Dialect
from mavhums.log.mavlink.scanner import Batch
from mavhums.log.words import GUARD

__all__ = ["SenderClocks"]

_FIELD = "time_boot_ms"


class SenderClocks:
    """Assigns each frame the latest ``time_boot_ms`` of the first system that sends one.

    Before the first one the time is 0. A step back of up to a minute, for example from a message
    that waited in a queue, is ignored; a larger one is a reboot.
    """

    def __init__(self, dialect: Dialect) -> None:
        wires = [definition.wire for definition in dialect.definitions.values()]
        self._places = np.array([_place(wire) for wire in wires], dtype=np.int64)
        self._system: int | None = None
        self._time_us = 0

    def set_times(self, batch: Batch) -> None:
        """Write the time of each frame into the batch's rows."""
        rows = batch.rows
        places = np.where(rows["message"] >= 0, self._places[rows["message"]], -1)
        speak = np.flatnonzero(places >= 0)
        if self._system is None and speak.size:
            self._system = int(rows["system"][speak[0]])
        speak = speak[rows["system"][speak] == self._system]
        begin = rows["offset"] - batch.base + GUARD + np.where(rows["flags"] & MAVLINK1, 6, 10)
        told_us = np.zeros(speak.size, dtype=np.int64)
        for byte in range(4):
            at = places[speak] + byte
            sent = np.where(
                at < rows["length"][speak],
                batch.data[np.minimum(begin[speak] + at, batch.data.size - 1)],
                0,
            )
            told_us += sent.astype(np.int64) << (8 * byte)
        told_us *= 1000
        times = np.empty(rows.size, dtype=np.int64)
        done = 0
        for row, time_us in zip(speak.tolist(), told_us.tolist(), strict=True):
            times[done:row] = self._time_us
            if not self._time_us - 60_000_000 <= time_us < self._time_us:
                self._time_us = time_us
            done = row
        times[done:] = self._time_us
        rows["time_us"] = times


def _place(wire: np.dtype[np.void]) -> int:
    return int(wire.fields[_FIELD][1]) if wire.fields and _FIELD in wire.fields else -1
