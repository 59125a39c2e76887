"""The airspeed that each vehicle reports, held until its next report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table

__all__ = ["AIRSPEED_MESSAGES", "Airspeeds"]

_FIELDS: Final = {"VFR_HUD": "airspeed", "ARSP": "Airspeed", "airspeed": "indicated_airspeed_m_s"}
AIRSPEED_MESSAGES: Final = frozenset(_FIELDS)

_FIRST: Final = (np.array([-(1 << 62)], dtype=np.int64), np.array([np.nan]))
_STALE_US: Final = 3_000_000
_KEPT_US: Final = 60_000_000

Times = NDArray[np.int64]
Array = NDArray[np.float64]


class Airspeeds:
    """Follows the airspeed of every vehicle, block by block, in constant memory.

    Examples
    --------
    >>> Airspeeds().at(1, np.array([0]))
    array([nan])
    """

    def __init__(self) -> None:
        self._known: dict[int, tuple[Times, Array]] = {}

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the reports in these messages."""
        for message, field in _FIELDS.items():
            table = tables.get(message)
            if table is not None and field in (table.fields.dtype.names or ()):
                self._take(table, table[field].astype(np.float64))

    def _take(self, table: Table, speed: Array) -> None:
        sound = np.isfinite(speed) & (speed >= 0.0)
        if "I" in (table.fields.dtype.names or ()):
            sound &= table["I"] == 0  # of several sensors, the first
        for vehicle in np.unique(table.system[sound]).tolist():
            rows = sound & (table.system == vehicle)
            before_us, before = self._known.get(vehicle, _FIRST)
            time_us = np.concatenate([before_us, table.time_us[rows]])
            self._known[vehicle] = np.maximum.accumulate(time_us), np.concatenate([before, speed[rows]])

    def at(self, vehicle: int, utc_us: Times) -> Array:
        """Return the airspeed at increasing times, m/s, shape (n,); NaN where it is unknown."""
        if vehicle not in self._known or not utc_us.size:
            return np.full(utc_us.size, np.nan)
        time_us, speed = self._known[vehicle]
        row = np.searchsorted(time_us, utc_us, side="right") - 1
        held: Array = np.where(utc_us - time_us[row] <= _STALE_US, speed[row], np.nan)
        kept = max(int(np.searchsorted(time_us, utc_us[-1] - _KEPT_US)) - 1, 0)
        self._known[vehicle] = time_us[kept:], speed[kept:]
        return held
