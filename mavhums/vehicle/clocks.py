"""The clocks of every sender and message of a log."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.clock import SenderClock

__all__ = ["Clocks", "Rows", "each"]

Rows = NDArray[Any] | slice
"""What picks rows: a mask, or places; all of them are a slice, for which nothing is copied."""


class Clocks:
    """The clocks of every sender and message, and the number of segments of each vehicle."""

    def __init__(self) -> None:
        self._clocks: dict[tuple[int, int, str], SenderClock] = {}
        self._restarts: list[tuple[int, int, int, int]] = []
        self._told: dict[int, int] = {}
        self._latest: dict[str, tuple[tuple[int, int, int], NDArray[np.int64]]] = {}

    def utc_us(
        self, table: Table, scale: int, field: str, *, wrap_us: int | None = None
    ) -> NDArray[np.int64]:
        """Return the times of a table's messages, microseconds of UTC, shape (n,).

        Several readers may ask for the times of one table: a clock takes each message once, else the times
        of a block in which it jumps would depend on where the block begins.

        Parameters
        ----------
        table
            Messages of one type, from any senders.
        scale
            Microseconds per unit of ``field``.
        field
            Name of the field with the sender's time.
        wrap_us
            Period after which the sender's time restarts.
        """
        if not len(table):
            return np.empty(0, dtype=np.int64)
        asked = (int(table.frame[0]), int(table.frame[-1]), len(table))
        before = self._latest.get(table.name)
        if before is None or before[0] != asked:
            before = self._latest[table.name] = asked, self._mapped(table, scale, field, wrap_us)
        return before[1]

    def _mapped(self, table: Table, scale: int, field: str, wrap_us: int | None) -> NDArray[np.int64]:
        utc_us = np.empty(len(table), dtype=np.int64)
        sent_us = table[field].astype(np.int64) * scale
        for sender, rows in each(table.system.astype(np.int64) * 256 + table.component):
            key = (sender // 256, sender % 256, table.name)
            clock = self._clocks.setdefault(key, SenderClock(wrap_us))
            utc_us[rows] = clock.to_utc_us(sent_us[rows], table.time_us[rows])
            frame, time_us = table.frame[rows], utc_us[rows]
            for row, segment in clock.restarts:
                self._restarts.append((int(frame[row]), sender // 256, segment, int(time_us[row])))
        return utc_us

    def jumps(self) -> list[tuple[int, int]]:
        """Return the vehicle and time, microseconds of UTC, of each jump since the last call.

        A reboot moves the clocks of all of a vehicle's messages. It is reported once, for the first of
        these messages in the order of the log.
        """
        found = []
        for _, vehicle, segment, time_us in sorted(self._restarts):
            if segment > self._told.get(vehicle, 1):
                self._told[vehicle] = segment
                found.append((vehicle, time_us))
        self._restarts.clear()
        return found


def each(keys: NDArray[Any], among: NDArray[np.bool_] | None = None) -> Iterator[tuple[int, Rows]]:
    """Yield each integer that occurs in ``keys`` (n,), with its rows, in increasing order.

    ``among`` (n,) selects the rows that count; None selects all.

    Examples
    --------
    >>> [(key, rows.tolist()) for key, rows in each(np.array([7, 3, 7]))]
    [(3, [1]), (7, [0, 2])]
    """
    if among is not None and not among.all():
        places = np.flatnonzero(among)
        yield from ((key, places[rows]) for key, rows in each(keys[places]))
    elif len(keys) and (keys == keys[0]).all():
        yield int(keys[0]), slice(None)
    else:
        for key in np.unique(keys):
            yield int(key), np.flatnonzero(keys == key)
