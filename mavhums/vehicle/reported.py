"""Faults that ESCs, servos, supplies and the autopilot report: flags, counts of errors, texts, a low supply.

Of three readings the middle one counts, as one may be damaged. What is kept is when a fault was reported
first, and how often. When the rail that feeds the servos sags, every surface is weak at once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.log import Table
from mavhums.results.sections import EventKind
from mavhums.vehicle.facts import FAULTS
from mavhums.vehicle.formats import by_vehicle, messages_of
from mavhums.vehicle.formats.base import FactReport, each

_ERRORS: Final = "ESC errors"  # a count; the others are bits
FAULT_FACTS: Final = (_ERRORS, *FAULTS)
FAULT_MESSAGES: Final = messages_of(*FAULT_FACTS)

_MOST: Final = 128  # devices that are followed, and faults that are kept
_NUMBERS: Final = 32  # a device's number beyond is damage
_TEXT: Final = re.compile(
    r"thrust loss|\b(motor|esc|servo)s? ?#?\d*\b.*\b(fail|fault|error|lost|offline|stuck|stall|desync|over)",
    re.IGNORECASE,
)
_NO_TEXT: Final = re.compile(r"arming|\b(pre|dis)?-?arm|preflight|calibrat|init|param", re.IGNORECASE)
"""Of texts that name a fault of a motor, an ESC or a servo: what refuses to arm, starts or sets one up."""


class Reported:
    """Follows what the devices of one vehicle report, block by block, in bounded memory."""

    def __init__(self) -> None:
        # By fact, message, component and number: the last two readings, their times, the last settled one.
        self._devices: dict[tuple[str, str, int, int], tuple[Array, Integers, int | None]] = {}
        self._known: dict[tuple[EventKind, str, str | None], tuple[float, int]] = {}
        self._new: list[tuple[float, str]] = []

    def hear_text(self, time_s: float, text: str) -> None:
        """Take a text of the vehicle."""
        if _TEXT.search(text) and not _NO_TEXT.search(text):
            self._note("fault", "the autopilot", f'"{text.strip()}"', np.array([time_s]), np.array([1]))

    def hear(self, report: FactReport, time_s: Array) -> list[tuple[float, str]]:
        """Take one of ``FAULT_FACTS``, rows of this vehicle alone, and their flight times, s, shape (n,).

        Returns
        -------
        list
            What was reported for the first time: its flight time, s, and words.
        """
        table, values, first = report.table, report.values, report.first
        devices = table.component.astype(np.int64) * _NUMBERS + first
        for device, rows in each(devices, (first >= 0) & (first < _NUMBERS)):
            component, number = divmod(device, _NUMBERS)
            for k, readings in enumerate(values[rows].T):
                key = report.source.fact, table.name, component, number + k
                if number + k < _NUMBERS and (key in self._devices or len(self._devices) < _MOST):
                    self._take(key, time_s[rows], readings)
        new, self._new = self._new, []
        return new

    def _take(self, key: tuple[str, str, int, int], time_s: Array, readings: Integers) -> None:
        """Take the next readings of one device."""
        fact, _, _, number = key
        last = None
        if key in self._devices:
            time_before, before, last = self._devices[key]
            time_s, readings = np.append(time_before, time_s), np.append(before, readings)
        if readings.size > 2:
            a, b, c = readings[:-2], readings[1:-1], readings[2:]
            middle = np.sort([a, b, c], axis=0)[1] if fact == _ERRORS else a & b | b & c | a & c
            if last is None:
                last = int(middle[0]) if fact == _ERRORS else 0 if FAULTS[fact].from_start else -1
            self._compare(fact, number + 1, time_s[1:-1], np.append(last, middle))
            last = int(middle[-1])
        self._devices[key] = time_s[-2:], readings[-2:], last

    def _compare(self, fact: str, number: int, time_s: Array, settled: Integers) -> None:
        """Note how each of the settled readings, (n + 1,), differs from the one before it."""
        before, after = settled[:-1], settled[1:]
        if (before == after).all():
            return
        if fact == _ERRORS:
            # A count that falls began anew: what it shows was counted since.
            more = np.where(after >= before, after - before, after)
            if self._note("errors", f"ESC {number}", None, time_s, more):
                self._new.append((float(time_s[more > 0][0]), f"the error count of ESC {number} grows"))
            return
        subject, words, _ = FAULTS[fact]
        for bit, said in enumerate(words):
            risen, who, what = (after & ~before) >> bit & 1, subject.format(n=number), said.format(n=number)
            if self._note("fault", who, what, time_s, risen):
                self._new.append((float(time_s[risen > 0][0]), f"{who} reports {what}"))

    def _note(self, kind: EventKind, subject: str, said: str | None, time_s: Array, more: Integers) -> bool:
        """Count reports; return whether these are the first."""
        key = kind, subject, said
        known = key in self._known
        if not more.any() or (not known and len(self._known) >= _MOST):
            return False
        first_s, count = self._known.get(key, (np.inf, 0))
        self._known[key] = min(first_s, float(time_s[more > 0].min())), count + int(more.sum())
        return not known

    def faults(self) -> Iterator[tuple[EventKind, float, dict[str, Any]]]:
        """Yield what was reported so far: kind of event, flight time of the first report, other fields."""
        # In an order that does not depend on the blocks, as times are rounded.
        for (kind, subject, said), (time_s, count) in sorted(self._known.items(), key=str):
            yield kind, time_s, {"subject": subject, "said": said, "value": float(count)}


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
        for vehicle, report in by_vehicle(tables, "servo rail"):
            time_us, volts = report.table.time_us, report.values[:, 0]
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
