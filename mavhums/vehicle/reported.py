"""Faults that ESCs, servos, supplies and the autopilot report: flags, counts of errors, texts, a low supply.

Of three readings the middle one counts, as one may be damaged. What is kept is when a fault was reported
first, and how often. When the rail that feeds the servos sags, every surface is weak at once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.results.sections import EventKind
from mavhums.vehicle.facts import FAULTS
from mavhums.vehicle.formats import messages_of
from mavhums.vehicle.formats.base import FactReport, each

_ERRORS: Final = "ESC errors"  # a count; the others are bits
FAULT_FACTS: Final = (_ERRORS, *FAULTS)
RAIL: Final = "servo rail"
FAULT_MESSAGES: Final = messages_of(*FAULT_FACTS, RAIL)

_MOST: Final = 128  # devices that are followed, and faults and sags that are kept
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


SAGS_SHARE: Final = 0.8
"""Share of its usual voltage below which a rail sags: servos of 5 V are made for 4.8 V, and a
healthy regulator dips by less when all servos start. By hand."""
_LEAST_V: Final = 3.3  # less feeds no servo: the rail is not connected to the sensor
_READINGS: Final = 20  # whose median is the usual voltage


class Sag(NamedTuple):
    """When a rail was too low, flight times, s, its lowest voltage and its usual one."""

    start_s: float
    end_s: float
    least_v: float
    usual_v: float

    def __str__(self) -> str:
        return f"it falls from {self.usual_v:.1f} to {self.least_v:.1f} V"


class ServoRail:
    """Follows the servo rail of one vehicle, block by block, in bounded memory.

    Attributes
    ----------
    sags
        Its sags so far.
    """

    def __init__(self) -> None:
        self.sags: list[Sag] = []
        self._kept: tuple[Array, Array] = np.empty(0), np.empty(0)
        self._usual_v: float | None = None

    def feed(self, time_s: Array, volts: Array) -> list[Sag]:
        """Take readings, V, shape (n,), and their flight times, s; return the sags that begin."""
        time_s, volts = np.append(self._kept[0], time_s), np.append(self._kept[1], volts)
        self._kept = time_s, volts
        if self._usual_v is None and volts.size < _READINGS:
            return []
        if self._usual_v is None:
            self._usual_v = float(np.median(volts[:_READINGS]))
        self._kept = time_s[-1:], volts[-1:]
        return [*self._sags(time_s, volts, self._usual_v)] if self._usual_v >= _LEAST_V else []

    def _sags(self, time_s: Array, volts: Array, usual_v: float) -> Iterator[Sag]:
        low = volts < SAGS_SHARE * usual_v
        both = np.flatnonzero(low[1:] & low[:-1])  # one low reading may be noise
        for part in np.split(both, np.flatnonzero(np.diff(both) > 1) + 1):
            if not part.size:
                continue
            start, end = int(part[0]), int(part[-1]) + 1
            found = Sag(
                float(time_s[start]), float(time_s[end]), float(volts[start : end + 1].min()), usual_v
            )
            last = self.sags[-1] if self.sags else None
            if last is not None and last.end_s == found.start_s:
                least_v = min(last.least_v, found.least_v)
                self.sags[-1] = found._replace(start_s=last.start_s, least_v=least_v)
            elif len(self.sags) < _MOST:
                self.sags.append(found)
                yield found
