"""What one source tells of one actuator, before sources are brought together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.clock import SenderClock
from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import KEYS
from mavhums.log import Table

__all__ = ["Clocks", "Reading", "Rows", "blank", "each"]

Rows = NDArray[Any] | slice
"""What picks rows: a mask, or places; all of them are a slice, for which nothing is copied."""


class Reading(NamedTuple):
    """New values from one source: a message, and which of its instances.

    Attributes
    ----------
    source
        As verdicts quote it, for example ``DEBUG_FLOAT_ARRAY[EMA,3]``.
    tier
        Name of the telemetry tier.
    fields
        Message field behind each quantity that the source can give, by key.
    frame
        Positions of the messages in the log, shape (n,), increasing.
    utc_us
        Times, microseconds of UTC, shape (n,).
    values
        V1…V12, shape (n, 12), NaN where not given.
    signed
        Whether the values have their sign; if not, they are magnitudes.
    """

    vehicle: int
    actuator: Actuator
    source: str
    tier: str
    fields: dict[str, str]
    frame: NDArray[np.int64]
    utc_us: NDArray[np.int64]
    values: NDArray[np.float64]
    signed: bool = True


class Clocks:
    """The clocks of every sender and message; how many segments a vehicle's have had."""

    def __init__(self) -> None:
        self._clocks: dict[tuple[int, int, str], SenderClock] = {}

    def utc_us(
        self, table: Table, scale: int, field: str, *, wrap_us: int | None = None
    ) -> NDArray[np.int64]:
        """Return the times of a table's messages, microseconds of UTC, shape (n,).

        Parameters
        ----------
        table
            Of one message type, any senders.
        scale
            Microseconds per unit of ``field``.
        field
            With the sender's time.
        wrap_us
            After which the sender's time starts anew.
        """
        utc_us = np.empty(len(table), dtype=np.int64)
        sent_us = table[field].astype(np.int64) * scale
        for sender, rows in each(table.system.astype(np.int64) * 256 + table.component):
            key = (sender // 256, sender % 256, table.name)
            clock = self._clocks.setdefault(key, SenderClock(wrap_us))
            utc_us[rows] = clock.to_utc_us(sent_us[rows], table.time_us[rows])
        return utc_us

    def segments(self, vehicle: int) -> int:
        """Return how many segments a vehicle's clock has had; more than one is a reboot or a jump."""
        return max((clock.segments for key, clock in self._clocks.items() if key[0] == vehicle), default=0)


def each(keys: NDArray[Any], among: NDArray[np.bool_] | None = None) -> Iterator[tuple[int, Rows]]:
    """Yield each of the whole numbers ``keys`` (n,) that occur, and where, in the order of their size.

    ``among`` (n,) are the rows that count; all if None.

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


def blank(columns: Sequence[int], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return V1…V12 of shape (n, 12), NaN but for the given columns, whose values are (n, k)."""
    out = np.full((len(values), len(KEYS)), np.nan)
    out[:, columns] = values
    return out
