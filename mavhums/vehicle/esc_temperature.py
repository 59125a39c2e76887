"""The median temperature that each ESC reports over a flight; the median is robust to outliers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table

__all__ = ["ESC_TEMPERATURE_MESSAGES", "EscTemperatures"]

_FIRST: Final = {f"ESC_TELEMETRY_{k + 1}_TO_{k + 4}": k for k in range(0, 32, 4)}
_DEGREES: Final = 256
_LEAST: Final = 10

ESC_TEMPERATURE_MESSAGES: Final = frozenset(_FIRST)


class EscTemperatures:
    """Counts the readings of every ESC, block by block, in constant memory.

    An ESC without a sensor reports zero.

    Examples
    --------
    >>> EscTemperatures().median(1, 0) is None
    True
    """

    def __init__(self) -> None:
        self._counts: dict[tuple[int, int], NDArray[np.int64]] = {}

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the readings in these messages."""
        for name, first in _FIRST.items():
            table = tables.get(name)
            if table is None:
                continue
            for vehicle in np.unique(table.system).tolist():
                degrees = table["temperature"][table.system == vehicle].astype(np.int64)
                for k in range(degrees.shape[1]):
                    counts = np.bincount(degrees[:, k], minlength=_DEGREES)
                    key = vehicle, first + k
                    self._counts[key] = self._counts.get(key, np.zeros(_DEGREES, dtype=np.int64)) + counts

    def median(self, vehicle: int, esc: int | None) -> float | None:
        """Return the median of an ESC's readings, °C; None if it has no sensor."""
        counts = None if esc is None else self._counts.get((vehicle, esc))
        if counts is None:
            return None
        told = counts.copy()
        told[0] = 0
        if told.sum() < _LEAST:
            return None
        return float(np.searchsorted(told.cumsum(), told.sum() / 2))
