"""Puts the messages of a MAVLink log on the time axes of their vehicles, once for all readers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from hashlib import shake_128
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Flags, Integers
from mavhums.log import Table
from mavhums.log.base.decoder import LOOSE_TIME
from mavhums.vehicle.formats.base import each
from mavhums.vehicle.formats.mavlink import STAMPS, stamp_of
from mavhums.vehicle.formats.px4_buses import PX4Buses
from mavhums.vehicle.time_axis import BOOT, BROKEN, LOOSE, UNSTAMPED, USEC, VehicleClock

_COUNTERS: Final = dict(zip(STAMPS, ((BOOT, 1000), (USEC, 1)), strict=True))  # counter, and its unit in µs
_LAPS_US: Final = {BOOT: 2**52, USEC: 2**32}  # a 64-bit stamp may be damaged beyond what can be added up
_REMEMBERED: Final = 4096  # messages of one type and sender: 40 s at 100 Hz
_STREAMS: Final = 1024  # streams whose messages are remembered, those heard last; forged senders are no more
_ECHO_US: Final = 5_000_000  # copies came up to 4.7 s later; sequence numbers start anew after some seconds
# One sender sends a type in order: its stamps run back at a reboot, and in 145 real logs three times at most.
# Of two clocks each second to fifth stamp does. A forger of a few frames must not silence a sender.
_PERIOD_US: Final = 30_000_000
_LEAST_REVERSALS: Final = 10
_REVERSALS_SHARE: Final = 8
_WEIGHTS: Final = np.frombuffer(shake_128(b"weights").digest(8 * 64), np.dtype("<u8")) | np.uint64(1)


class Clocks:
    """The time axes of all vehicles of a log, block by block.

    Attributes
    ----------
    copies, broken
        Messages left out, by their names: those that arrived before, as over several routes, and those with
        a stamp that no clock explains.
    """

    def __init__(self) -> None:
        self.copies, self.broken = Counter[str](), Counter[str]()
        self._buses = PX4Buses()
        self._vehicles: dict[int, VehicleClock] = {}
        self._seen: dict[tuple[str, int], tuple[Integers, NDArray[np.uint64]]] = {}
        self._routes: dict[int, int] = {}
        self._orders: dict[tuple[str, int], _Order] = {}
        self._mixed: dict[int | None, set[str]] = {}
        self._restarts: list[tuple[int, int, int, int]] = []
        self._last_segment: dict[int, int] = {}

    def feed(
        self, tables: Mapping[str, Table], admits: Callable[[int], bool] = lambda _: True
    ) -> dict[str, Table]:
        """Return the tables with ``time_us`` on the senders' clocks, without copies and broken stamps.

        The times of a log whose messages carry no stamp, as an on-board log, stay as they are. PX4's outputs
        get the places of their drivers. ``admits`` returns whether a
        vehicle is followed.
        """
        tables = self._buses.feed(tables)
        stamps = {name: stamp_of(table) for name, table in tables.items()}
        if not tables or not (self._vehicles or any(stamps.values())):
            return dict(tables)
        names = list(tables)
        edges = np.cumsum([0, *(len(tables[name]) for name in names)])
        frame, system, component, received = (
            np.concatenate([getattr(tables[name], part) for name in names])
            for part in ("frame", "system", "component", "time_us")
        )
        counter, stamp_us = _stamps(tables, stamps)
        order = np.argsort(frame, kind="stable")
        time_us, worth = received.copy(), np.zeros(received.size, dtype=np.int64)
        for vehicle, rows in each(system[order]):
            picked = order[rows]
            if not admits(vehicle):
                continue
            if vehicle not in self._vehicles:
                if (counter[picked] == UNSTAMPED).all():
                    continue
                self._vehicles[vehicle] = VehicleClock()
            senders = component[picked].astype(np.int64)
            mapped = self._vehicles[vehicle].map(senders, counter[picked], stamp_us[picked], received[picked])
            time_us[picked], worth[picked] = mapped.time_us, mapped.worth
            for row in np.flatnonzero(mapped.segment).tolist():
                place = int(frame[picked[row]])
                self._restarts.append((place, vehicle, int(mapped.segment[row]), int(mapped.time_us[row])))
        spans = {name: slice(*edges[k : k + 2]) for k, name in enumerate(names)}
        kept = {  # messages with stamps first: they show whether there are several routes
            name: self._kept(tables[name], stamps[name], stamp_us[span], time_us[span], worth[span])
            for name, span in sorted(spans.items(), key=lambda item: stamps[item[0]] is None)
        }
        return {name: kept[name] for name in names}

    def at_us(self, vehicle: int, received_us: int) -> int:
        """Return what a vehicle's clock shows at a time of reception; that time if it sends none."""
        clock = self._vehicles.get(vehicle)
        return received_us if clock is None else clock.at_us(received_us)

    def jumps(self) -> list[tuple[int, int]]:
        """Return the vehicle and time, microseconds of UTC, of each jump since the last call.

        A reboot moves the clocks of all of a vehicle's components. It is reported once, for the first of
        these in the order of the log.
        """
        found = []
        for _, vehicle, segment, time_us in sorted(self._restarts):
            if segment > self._last_segment.get(vehicle, 1):
                self._last_segment[vehicle] = segment
                found.append((vehicle, time_us))
        self._restarts.clear()
        return found

    @property
    def mixed(self) -> dict[int | None, str]:
        """The vehicles that are several senders, and of each a message whose stamps are of several clocks."""
        found = {vehicle: set(names) for vehicle, names in self._mixed.items()}
        for (name, sender), order in self._orders.items():
            if order.mixed:
                found.setdefault(sender >> 8, set()).add(name)
        return {vehicle: min(names) for vehicle, names in found.items() if names}

    def _kept(
        self, table: Table, stamp: str | None, stamp_us: Integers, time_us: Integers, worth: Integers
    ) -> Table:
        """Return the table with its times, without broken stamps and copies."""
        received_us = table.time_us
        flags = table.flags | np.where(worth == LOOSE, LOOSE_TIME, 0).astype(np.uint8)
        table = replace(table, time_us=time_us, flags=flags)
        broken = worth == BROKEN
        copied = self._copied(table, ~broken, stamped=stamp is not None)
        if stamp is not None:
            lap_us = _LAPS_US[_COUNTERS[stamp][0]]
            self._follow_order(table, ~copied & (stamp_us > 0), stamp_us, received_us // _PERIOD_US, lap_us)
        if not (broken.any() or copied.any()):
            return table
        for rows, counts in ((broken, self.broken), (copied, self.copies)):
            if rows.any():
                counts[table.name] += int(rows.sum())
        return table.select(~(broken | copied))

    def _follow_order(
        self, table: Table, own: Flags, stamp_us: Integers, period: Integers, lap_us: int
    ) -> None:
        """Count how often the stamps of each sender run back, in each period of reception."""
        for sender, rows in each(table.system.astype(np.int64) * 256 + table.component, own):
            stamps, periods = stamp_us[rows], period[rows]
            order = self._orders.pop((table.name, sender), _Order(int(stamps[0]), int(periods[0]), 0, 0))
            steps = np.diff(stamps, prepend=order.stamp_us)
            back = (steps + lap_us // 2) % lap_us < lap_us // 2
            edges = np.flatnonzero(np.diff(periods, prepend=order.period)).tolist()
            for a, b in pairwise([0, *edges, stamps.size]):
                if a in edges:
                    if order.mixed:
                        self._mixed.setdefault(sender >> 8, set()).add(table.name)
                    order = _Order(order.stamp_us, int(periods[a]), 0, 0)
                messages, reversals = order.messages + b - a, order.reversals + int(back[a:b].sum())
                order = order._replace(messages=messages, reversals=reversals)
            self._orders[table.name, sender] = order._replace(stamp_us=int(stamps[-1]))
            _forget_oldest(self._orders)

    def _copied(self, table: Table, sound: Flags, *, stamped: bool) -> Flags:
        """Return which messages arrived before: same sender, stamp, sequence number and content.

        Without a stamp, the same content and 8-bit sequence number may be a new message, too. So only senders
        whose stamped messages came over several routes are checked, and only over seconds.
        """
        copied = np.zeros(len(table), dtype=np.bool_)
        if not (stamped or self._routes):
            return copied
        codes = _codes(table, timed=stamped)
        for sender, rows in each(table.system.astype(np.int64) * 256 + table.component, sound):
            places = np.arange(len(table))[rows]
            if not stamped:  # what came before the second route was found is no copy
                places = places[table.frame[places] > self._routes.get(sender, 1 << 62)]
            if not places.size:
                continue
            heard_us, before = self._seen.pop((table.name, sender), (table.time_us[:0], codes[:0]))
            time_us = np.concatenate([heard_us, table.time_us[places]])
            known = np.concatenate([before, codes[places]])
            if not stamped or (np.diff(time_us) <= 0).any():
                copied[places] = again = _repeated(known, time_us)[before.size :]
                if stamped and again.any():
                    first = int(table.frame[places][again][0])
                    self._routes[sender] = min(first, self._routes.get(sender, first))
            recent = stamped | (time_us >= time_us.max(initial=0) - _ECHO_US)
            self._seen[table.name, sender] = time_us[recent][-_REMEMBERED:], known[recent][-_REMEMBERED:]
            _forget_oldest(self._seen)
        return copied


class _Order(NamedTuple):
    """How the stamps of a message run: the last one, and the counts of the present period."""

    stamp_us: int
    period: int
    messages: int
    reversals: int

    @property
    def mixed(self) -> bool:
        """Whether the stamps of the period are of more than one clock."""
        return self.reversals >= max(_LEAST_REVERSALS, self.messages / _REVERSALS_SHARE)


def _forget_oldest(streams: dict[tuple[str, int], Any]) -> None:
    """Forget the stream that was heard least recently, if there are too many."""
    if len(streams) > _STREAMS:
        del streams[next(iter(streams))]


def _codes(table: Table, *, timed: bool = True) -> NDArray[np.uint64]:
    """Return a hash of each message's time, if it has one, sequence number and content, shape (n,)."""
    size = table.fields.dtype.itemsize
    words = np.zeros((len(table), -(-size // 8) + 2), dtype=np.uint64)
    words[:, 0], words[:, 1] = table.time_us.astype(np.uint64) if timed else 0, table.sequence
    raw = np.ascontiguousarray(table.fields).view(np.uint8).reshape(len(table), size)
    words[:, 2:].view(np.uint8)[:, :size] = raw
    return words @ np.resize(_WEIGHTS, words.shape[1])


def _repeated(codes: NDArray[np.uint64], time_us: Integers) -> Flags:
    """Return which codes occurred among those of the seconds before them, however the log is cut."""
    order = np.argsort(codes, kind="stable")
    again = np.zeros(codes.size, dtype=np.bool_)
    same = (codes[order][1:] == codes[order][:-1]) & (np.diff(order) <= _REMEMBERED)
    same &= np.diff(time_us[order]) <= _ECHO_US
    again[order[1:][same]] = True
    return again


def _stamps(tables: Mapping[str, Table], stamps: Mapping[str, str | None]) -> tuple[Integers, Integers]:
    """Return the counter and the stamp of every message, table after table; a stamp of 0 is none."""
    counters, stamps_us = [], []
    for name, table in tables.items():
        stamp = stamps[name]
        raw = np.zeros(len(table), dtype=np.int64)
        counter = np.full(len(table), UNSTAMPED, dtype=np.int64)
        if stamp is not None:
            kind, scale = _COUNTERS[stamp]
            raw = table[stamp].astype(np.uint64)
            counter[raw > 0] = kind
            raw = (raw * np.uint64(scale) % np.uint64(_LAPS_US[kind])).astype(np.int64)
        counters.append(counter)
        stamps_us.append(raw)
    return np.concatenate(counters), np.concatenate(stamps_us)
