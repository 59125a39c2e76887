"""The voltage of the rail that feeds the servos: when it sags, every surface is weak at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.log import Table
from mavhums.vehicle.formats import each, messages_of, reports

RAIL_MESSAGES: Final = messages_of("servo rail")

SAGS_SHARE: Final = 0.8
"""Share of its usual voltage below which a rail sags: servos of 5 V are made for 4.8 V, and a
healthy regulator dips by less when all servos start. By hand."""
_LEAST_V: Final = 3.3  # less feeds no servo: the rail is not connected to the sensor
_READINGS: Final = 20  # whose median is the usual voltage


class Sag(NamedTuple):
    """When a rail was too low, in µs of the vehicle's clock, its lowest voltage and its usual one."""

    start_us: int
    end_us: int
    least_v: float
    usual_v: float

    def __str__(self) -> str:
        return f"it falls from {self.usual_v:.1f} to {self.least_v:.1f} V"


class ServoRails:
    """Follows the servo rail of each vehicle, block by block.

    Attributes
    ----------
    lowest
        The deepest sag of each vehicle so far.
    """

    def __init__(self) -> None:
        self.lowest: dict[int, Sag] = {}
        self._kept: dict[int, tuple[Integers, Array]] = {}
        self._usual_v: dict[int, float] = {}
        self._now: dict[int, Sag] = {}

    def feed(self, tables: Mapping[str, Table]) -> Iterator[tuple[int, Sag]]:
        """Take the readings in these messages; yield vehicle and sag where a rail begins to sag."""
        for report in reports(tables, "servo rail"):
            for vehicle, rows in each(report.table.system):
                time_us, volts = report.table.time_us[rows], report.values[rows, 0]
                if vehicle in self._kept:
                    before = self._kept[vehicle]
                    time_us, volts = np.concatenate([before[0], time_us]), np.concatenate([before[1], volts])
                self._kept[vehicle] = time_us, volts
                if volts.size < _READINGS and vehicle not in self._usual_v:
                    continue
                usual_v = self._usual_v.setdefault(vehicle, float(np.median(volts[:_READINGS])))
                self._kept[vehicle] = time_us[-1:], volts[-1:]
                if usual_v >= _LEAST_V:
                    yield from self._sags(vehicle, time_us, volts, usual_v)

    def _sags(
        self, vehicle: int, time_us: Integers, volts: Array, usual_v: float
    ) -> Iterator[tuple[int, Sag]]:
        low = volts < SAGS_SHARE * usual_v
        both = np.flatnonzero(low[1:] & low[:-1])  # one low reading may be noise
        for part in np.split(both, np.flatnonzero(np.diff(both) > 1) + 1):
            if not part.size:
                continue
            start, end = int(part[0]), int(part[-1]) + 1
            found = Sag(int(time_us[start]), int(time_us[end]), float(volts[start : end + 1].min()), usual_v)
            last = self._now.get(vehicle)
            if last is not None and last.end_us == found.start_us:
                found = found._replace(start_us=last.start_us, least_v=min(last.least_v, found.least_v))
            else:
                yield vehicle, found
            self._now[vehicle] = found
            deepest = self.lowest.get(vehicle)
            if deepest is None or found.start_us == deepest.start_us or found.least_v < deepest.least_v:
                self.lowest[vehicle] = found
