"""Joins what inertial sensors record faster than any stream: bursts of samples, and fast records.

A burst is a header and parts of 32 samples, which the autopilot writes while it flies on. A part belongs to
the last header before it with its number, and to none that is more than :data:`_OPEN` headers back: parts of
a header that is lost are lost.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.log import Table
from mavhums.vehicle.formats import by_vehicle, messages_of, reports

FAST_FORCE_MESSAGES: Final = messages_of("burst", "burst samples", "fast force")
"""Messages of any format that carry the specific force faster than the streams do."""
_OPEN: Final = 8
_PART: Final = 32  # samples
_MOST_PARTS: Final = 2048
_HERTZ: Final = (50.0, 40_000.0)
_MOST_DELAY_US: Final = 60e6  # between a sample and its record: more is damage


class FastForce(NamedTuple):
    """Specific force of one vehicle: message, microseconds of UTC, (n,), and m/s², (n, 3)."""

    vehicle: int
    source: str
    time_us: Integers
    values: Array


class _Header(NamedTuple):
    frame: int
    number: float
    start_us: float
    period_us: float
    scale: float


class Bursts:
    """Joins the bursts of all vehicles, whatever the block size.

    Examples
    --------
    >>> [*Bursts().feed({})]
    []
    """

    def __init__(self) -> None:
        self._headers: dict[int, list[_Header]] = {}

    def feed(self, tables: Mapping[str, Table]) -> Iterator[FastForce]:
        """Yield the specific force in these messages that no stream carries."""
        for vehicle, report in by_vehicle(tables, "fast force"):
            delay_us, force = np.split(report.values, [1], axis=1)
            known = np.isfinite(force).all(axis=1) & (np.abs(delay_us[:, 0]) < _MOST_DELAY_US)
            if known.any():
                time_us = report.table.time_us[known] + delay_us[known, 0].astype(np.int64)
                yield FastForce(vehicle, report.table.name, time_us, force[known])
        for report in reports(tables, "burst"):
            self._open(report.table, report.values)
        for vehicle, report in by_vehicle(tables, "burst samples"):
            for time_us, force in self._join(vehicle, report.table.frame, report.values):
                yield FastForce(vehicle, report.table.name, time_us, force)
        for vehicle, headers in self._headers.items():
            self._headers[vehicle] = headers[-_OPEN:]

    def _open(self, table: Table, values: Array) -> None:
        number, delay_us, hertz, divisor = values.T
        good = (np.abs(delay_us) < _MOST_DELAY_US) & (divisor > 0.0)
        good &= (hertz >= _HERTZ[0]) & (hertz <= _HERTZ[1])
        for k in np.flatnonzero(good).tolist():
            header = _Header(
                frame=int(table.frame[k]),
                number=float(number[k]),
                start_us=float(table.time_us[k]) + float(delay_us[k]),
                period_us=1e6 / float(hertz[k]),
                scale=1.0 / float(divisor[k]),
            )
            self._headers.setdefault(int(table.system[k]), []).append(header)

    def _join(self, vehicle: int, frame: Integers, values: Array) -> Iterator[tuple[Integers, Array]]:
        headers = self._headers.get(vehicle, [])
        frames = [header.frame for header in headers]
        for k, header in enumerate(headers):
            later = headers[k + 1 : k + 1 + _OPEN]
            same = [one.frame for one in later if one.number == header.number]
            end = min([*same, *frames[k + _OPEN : k + _OPEN + 1]], default=None)
            a = int(np.searchsorted(frame, header.frame))
            b = len(frame) if end is None else int(np.searchsorted(frame, end))
            number, part = values[a:b, :2].T
            rows = a + np.flatnonzero((number == header.number) & (part < _MOST_PARTS))
            if rows.size:
                places = values[rows, 1:2] * _PART + np.arange(_PART)
                time_us = np.rint(header.start_us + places.ravel() * header.period_us).astype(np.int64)
                axes = values[rows, 2:].reshape(-1, 3, _PART).transpose(0, 2, 1)
                yield time_us, axes.reshape(-1, 3) * header.scale
