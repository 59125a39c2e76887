"""Determines the vehicle of a log, and the UTC of its boot.

Both must be known before any output, so that results do not depend on block ends: the records of a log
are buffered until the vehicle's id and the first valid GPS time have passed, for at most a megabyte.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Final

import numpy as np

from mavhums.log.base.tables import ODD_TIME, Table

__all__ = ["DATING_MESSAGES", "Dating"]

DATING_MESSAGES: Final = frozenset({"PARM", "GPS"})
"""Messages with the vehicle's id and the date."""

_IDS: Final = (b"SYSID_THISMAV", b"MAV_SYSID")
_HELD: Final = 1 << 20
_FIX: Final = 3
_WEEK_US: Final = 7 * 86_400 * 1_000_000


def _us(year: int, month: int, day: int) -> int:
    return round(datetime(year, month, day, tzinfo=UTC).timestamp()) * 1_000_000


_GPS_EPOCH_US: Final = _us(1980, 1, 6)
_LEAP_SECONDS: Final = (
    (_us(2017, 1, 1), 18),
    (_us(2015, 7, 1), 17),
    (_us(2012, 7, 1), 16),
)
"""Seconds by which GPS time was ahead of UTC from a day on (IERS Bulletin C)."""


class Dating:
    """The vehicle and the UTC offset that one log of a stream reports.

    Parameters
    ----------
    start
        Offset at which the log begins in the stream.

    Attributes
    ----------
    vehicle
        Id of the vehicle, 1 if the log does not report it.
    offset_us
        UTC at boot, microseconds; None if the log does not report it.
    end
        Offset in the stream from which on records are ignored.
    """

    def __init__(self, start: int) -> None:
        self.vehicle = 1
        self.offset_us: int | None = None
        self._identified = False
        self.end = start + _HELD

    def observe(self, tables: Mapping[str, Table]) -> None:
        """Process the records before ``end``."""
        parameters, positions = tables.get("PARM"), tables.get("GPS")
        if parameters is not None and not self._identified:
            told = np.isin(parameters["Name"], _IDS)
            for value in parameters["Value"][told].tolist():
                if not self._identified and 1 <= value <= 255:
                    self.vehicle, self._identified = int(value), True
        if positions is not None and self.offset_us is None:
            self._date(positions)

    def is_settled(self, position: int) -> bool:
        """Return whether the result is final at ``position`` of the stream."""
        return (self._identified and self.offset_us is not None) or position >= self.end

    def _date(self, positions: Table) -> None:
        names = positions.fields.dtype.names or ()
        if not {"TimeUS", "Status", "GMS", "GWk"} <= set(names):
            return
        good = (positions["Status"] >= _FIX) & (positions["GWk"] > 0)
        good &= positions.flags & ODD_TIME == 0
        if not good.any():
            return
        first = int(np.argmax(good))
        gps_us = int(positions["GWk"][first]) * _WEEK_US + int(positions["GMS"][first]) * 1000
        utc_us = _GPS_EPOCH_US + gps_us
        ahead_s = next((seconds for since, seconds in _LEAP_SECONDS if utc_us >= since), 15)
        self.offset_us = utc_us - ahead_s * 1_000_000 - int(positions["TimeUS"][first])
