"""Counts over a whole log, in constant memory: the temperatures of ESCs, and the names of named values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Final

import numpy as np

from mavhums.core.arrays import Integers
from mavhums.log import Table
from mavhums.log.base.tables import text_of
from mavhums.vehicle.formats import each, messages_of, reports

__all__ = ["ESC_TEMPERATURE_MESSAGES", "NAMED_MESSAGES", "EscTemperatures", "NamedValues"]

ESC_TEMPERATURE_MESSAGES: Final = messages_of("ESC temperature")
NAMED_MESSAGES: Final = messages_of("named value")

_DEGREES: Final = 256  # what one byte can say
_LEAST_READINGS: Final = 10
"""Readings of a temperature from which its median counts: of fewer, single errors move it."""
_MOST_NAMES: Final = 1000  # of a log: a sender that makes up names cannot fill the memory


class EscTemperatures:
    """Counts the readings of every ESC, block by block; the median is robust to outliers.

    An ESC without a sensor reports zero.

    Examples
    --------
    >>> EscTemperatures().median(1, 0) is None
    True
    """

    def __init__(self) -> None:
        self._counts: dict[tuple[int, int], Integers] = {}

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the readings in these messages."""
        for report in reports(tables, "ESC temperature"):
            values = report.values.astype(np.int64)
            for vehicle, rows in each(report.table.system):
                for k, degrees in enumerate(values[rows].T):
                    counts = np.bincount(degrees, minlength=_DEGREES)
                    key = vehicle, report.source.first + k
                    self._counts[key] = self._counts.get(key, np.zeros(_DEGREES, dtype=np.int64)) + counts

    def median(self, vehicle: int, esc: int | None) -> float | None:
        """Return the median of an ESC's readings, °C; None if it has no sensor."""
        counts = None if esc is None else self._counts.get((vehicle, esc))
        if counts is None:
            return None
        measured = counts.copy()
        measured[0] = 0
        if measured.sum() < _LEAST_READINGS:
            return None
        return float(np.searchsorted(measured.cumsum(), measured.sum() / 2))


class NamedValues:
    """Counts named values, which scripts and autopilots send under their own names.

    Attributes
    ----------
    counts
        Counts by (system, message, name); only the first thousand names of a log are counted.
    """

    def __init__(self) -> None:
        self.counts: Counter[tuple[int, str, str]] = Counter()

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the named values in these messages."""
        for report in reports(tables, "named value"):
            values = report.values
            for system, rows in each(report.table.system):
                names, counts = np.unique(values[rows], return_counts=True)
                for name, count in zip(names.tolist(), counts.tolist(), strict=True):
                    key = (system, report.source.message, text_of(name))
                    if key in self.counts or len(self.counts) < _MOST_NAMES:
                        self.counts[key] += int(count)
