"""The events of a flight: seen once, while the log is read, and said everywhere.

Whatever sees one adds it to the list of its vehicle. What depends on the flight as a whole, as whether a
source of telemetry came back, is decided when the list is asked for. So the list depends neither on how the
log was cut nor on when it was asked for before.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Container, Iterator, Mapping, Sequence, Set
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.log import Table
from mavhums.results.reasons import Reason
from mavhums.results.sections import EventKind, FlightEvent
from mavhums.vehicle.facts import ARDUPILOT, ON_GROUND
from mavhums.vehicle.formats import by_vehicle
from mavhums.vehicle.grid import RATE_HZ, Seconds
from mavhums.vehicle.phases import CONTACT, LANDING, TAKE_OFF, PhaseRows, Phases
from mavhums.vehicle.reported import FAULT_FACTS, RAIL, SAGS_SHARE, Reported, ServoRail
from mavhums.vehicle.rotors import Rotors

_MOST: Final = 100  # of a kind and vehicle: what comes later is counted, as memory is bounded
_SUBJECTS: Final = 64  # whose telemetry is followed
_AT_ONCE_S: Final = 2.0  # a flight whose evidence is there from the first seconds began before the log
_TOUCHES_S, _ENDS_WITHIN_S = 2.0, 10.0
"""Between a contact and the landing or the end that it leads to: less is a touch-down, and what turns an
aircraft that flies on as no motor can may as well be the vibration of its gyros."""
_MISSING_S: Final = 10.0  # a source of telemetry that is silent for less may be lost on a bad link
_MISSING: Final = 20  # ... and of a slow one so many of its usual distances
_NEVER_AIRBORNE: Final = frozenset({5, 6, 10, 11, 12})
"""MAV_TYPEs of what does not fly: antenna tracker, ground station, rover, boat, submarine."""

_HELD_S, _HOLDS_M, _SINKS_S, _SINKS_M = 20, 10.0, 10, 8.0
_STAYS_M, _FOLLOWS_RAD = 2.0, 0.15
"""A wing that held its altitude for as long, and then sinks below it though its autopilot demands the same
one and its attitude follows, lacks thrust, or control: on purpose it sinks with its demand."""
_HITS_M: Final = 6.0
"""What a wing that hits the ground sinks in the last seconds before it is at rest, see ``PhaseEvent``: midway
between the hardest of 45 landings, 2.7 m, and the softer of two crashes, 12 m."""
_HOLDING_MODES: Final = (6, 7, 10, 11, 12, 15)
"""FBWB, CRUISE, AUTO, RTL, LOITER, GUIDED of ArduPlane: in others the pilot decides how high it flies."""
_CRASH: Final = re.compile(r"crash(:| detected)", re.IGNORECASE)
_FAILSAFE: Final = re.compile(r"fail-?safe", re.IGNORECASE)
_NO_FAILSAFE: Final = re.compile(
    r"^(?:pre-?)?arm|clear|\boff\b|disabled|recover|resum|restored|ended|not |no failsafe|param|set ",
    re.IGNORECASE,
)
"""Of texts that name a failsafe: what ends one, sets one up or refuses to arm."""


class VehicleEvents:
    """Follows the events of one vehicle in bounded memory.

    Parameters
    ----------
    vehicle
        System id.

    Attributes
    ----------
    reported, rail
        What its devices report of their own faults, and its servo rail.
    """

    def __init__(self, vehicle: int) -> None:
        self._vehicle = vehicle
        self._kept: dict[EventKind, list[FlightEvent]] = {}
        self._phases = Phases()
        self._armed = np.nan
        self._kind = np.nan
        self._on_ground = False
        self._first_s: int | None = None
        self._begun: tuple[EventKind, float] = "begins_in_air", 0.0
        self._last_s = 0.0
        self._sources: dict[str, tuple[float, float, int]] = {}
        self._ended = False
        self.reported, self.rail = Reported(), ServoRail()
        self._course: deque[tuple[float, ...]] = deque(maxlen=_HELD_S + _SINKS_S)
        self._sank_s = -np.inf
        self.left_out = 0

    def add(self, kind: EventKind, time_s: float, **about: str | float) -> None:
        """Add an event; ``about`` are further fields of :class:`mavhums.results.sections.FlightEvent`."""
        kept = self._kept.setdefault(kind, [])
        if len(kept) < _MOST:
            kept.append(self._event(kind, time_s, **about))
        else:
            self.left_out += 1

    def hear_text(self, time_s: float, text: str) -> None:
        """Take a text of the vehicle."""
        self.reported.hear_text(time_s, text)
        if _CRASH.match(text):
            self.add("crash", time_s, said=text)
        if _FAILSAFE.search(text) and not _NO_FAILSAFE.search(text):
            self.add("failsafe", time_s, said=text)

    def hear_source(self, subject: str, time_s: Array) -> None:
        """Take the flight times, s, shape (n,), at which a source of telemetry reported."""
        if time_s.size and (subject in self._sources or len(self._sources) < _SUBJECTS):
            first, last, count = self._sources.get(subject, (float(time_s[0]), -np.inf, 0))
            self._sources[subject] = first, max(last, float(time_s.max())), count + time_s.size

    def feed(self, seconds: Seconds, rotors: Rotors | Reason | None = None) -> PhaseRows:
        """Take settled seconds that follow each other; return the phases of the flight in them.

        Parameters
        ----------
        rotors
            The motors of a multirotor; anything else where they are not known.
        """
        first = int(seconds.index[0])
        self._first_s = first if self._first_s is None else self._first_s
        self._last_s = float(seconds.index[-1] + 1)
        states = seconds.signals["state"].reshape(-1, 4)
        kinds = states[np.isfinite(states[:, 0]), 0]
        self._kind = float(kinds[-1]) if kinds.size else self._kind
        known = np.flatnonzero(np.isfinite(states[:, 2]))
        armed = np.append(self._armed, states[known, 2] > 0)
        for change in np.flatnonzero(np.isfinite(armed[:-1]) & (np.diff(armed) != 0)).tolist():
            self.add("armed" if armed[change + 1] else "disarmed", first + known[change] / RATE_HZ)
        self._armed = float(armed[-1])
        self._on_ground |= bool(_is_grounded(seconds)[: int(_AT_ONCE_S)].any()) and first == self._first_s
        phases = self._phases.feed(seconds, rotors)
        self._look_for_sinking(seconds, phases.airborne[::RATE_HZ])
        for event in phases.events:
            if event.kind == TAKE_OFF:
                at_once = event.time_s - self._first_s <= _AT_ONCE_S and not self._on_ground
                self._begun = "begins_in_air" if at_once else "take_off", max(event.time_s, 0.0)
            elif event.kind == CONTACT:
                self.add("contact", event.time_s)
            elif event.kind == LANDING and event.certain:
                self.add(*self._begun)
                self.add("landing", event.time_s)
                if event.sank_m >= _HITS_M:
                    self.add("impact", event.time_s, value=round(event.sank_m, 1))
        return phases

    def _look_for_sinking(self, seconds: Seconds, airborne: Flags) -> None:
        """Look for a second up to which it sinks although its autopilot demands no less altitude."""
        signals = seconds.signals
        altitude, below = (signals[name][:, :, 0].mean(axis=1) for name in ("altitude", "altitude error"))
        off = np.abs(signals["attitude"][:, :, :2] - signals["demand"]).mean(axis=1).max(axis=1)
        state = signals["state"][:, -1]
        holds = airborne & (state[:, 1] == ARDUPILOT) & np.isin(state[:, 3], _HOLDING_MODES)
        off = np.where(holds, off, np.nan)
        for row in zip(seconds.index.tolist(), altitude, altitude + below, off, strict=True):
            known = bool(np.isfinite(row).all())
            if not known or (self._course and row[0] != self._course[-1][0] + 1):
                self._course.clear()
            if known:
                self._course.append(row)
            if len(self._course) < _HELD_S + _SINKS_S:
                continue
            _, height, demanded, turned = np.array(self._course).T
            held = height[:_HELD_S]
            sunk = float(held.min() - height[-1])
            follows = np.median(turned[_HELD_S:]) < _FOLLOWS_RAD
            if follows and np.ptp(demanded) < _STAYS_M and np.ptp(held) < _HOLDS_M and sunk >= _SINKS_M:
                if row[0] - self._sank_s > _HELD_S:
                    self.add("altitude_loss", row[0], value=round(sunk, 1))
                self._sank_s = row[0]

    def finish(self) -> None:
        """End the input."""
        self._ended = True

    def events(self, *, rotors: bool) -> list[FlightEvent]:
        """Return what happened so far, in order of time.

        Parameters
        ----------
        rotors
            Whether it is carried by rotors alone: only for these a contact differs from ordinary flight.
        """
        found = [event for kept in self._kept.values() for event in kept]
        found += [self._event(kind, time_s, **about) for kind, time_s, about in self.reported.faults()]
        found += [self._event("supply", sag.start_s, value=round(sag.least_v, 2)) for sag in self.rail.sags]
        flies = self._phases.certain and self._kind not in _NEVER_AIRBORNE
        found += [self._event(*self._begun)] if flies else []
        flights = [*self._flights(found)]
        found = [event for event in found if self._holds(event, flights, rotors=rotors)]
        if flies and self._ended and not self._phases.turning:
            found.append(self._event("ends_in_air", self._last_s))
        for subject, (first, last, count) in self._sources.items():
            missing = max(_MISSING_S, _MISSING * (last - first) / count)
            until = next((end for begin, end in flights if begin <= last and end - last > missing), None)
            if until is not None and count >= _MISSING:
                found.append(
                    self._event("telemetry_ends", last, subject=subject, value=round(until - last, 1))
                )
        return found

    def _event(self, kind: EventKind, time_s: float, **about: str | float) -> FlightEvent:
        fields = {"kind": kind, "vehicle": self._vehicle, "time_s": round(time_s, 2), **about}
        return FlightEvent.model_validate(fields)

    def _flights(self, found: Sequence[FlightEvent]) -> Iterator[tuple[float, float]]:
        """Yield when it took off and landed; of a flight that has not ended the latest second."""
        if self._kind in _NEVER_AIRBORNE:
            return
        begins = [one.time_s for one in found if one.kind in ("begins_in_air", "take_off")]
        ends = [one.time_s for one in self._kept.get("landing", ())]
        for begin in sorted(begins):
            yield begin, next((end for end in ends if end >= begin), self._last_s)

    def _holds(self, event: FlightEvent, flights: list[tuple[float, float]], *, rotors: bool) -> bool:
        """Return whether an event is one, given the flights of the log."""
        if event.kind in ("take_off", "landing", "begins_in_air"):
            return self._kind not in _NEVER_AIRBORNE
        if event.kind == "reboot":
            return any(begin < event.time_s < end for begin, end in flights)
        if event.kind == "supply":  # whoever switches off after the landing lets the rail fall, too
            return not flights or any(begin < event.time_s < end for begin, end in flights)
        if event.kind == "altitude_loss":
            return not rotors and any(begin <= event.time_s < end for begin, end in flights)
        if event.kind == "contact":
            left_s = [end - event.time_s for begin, end in flights if begin < event.time_s <= end]
            return rotors and any(_TOUCHES_S < one <= _ENDS_WITHIN_S for one in left_s)
        return True


def _is_grounded(seconds: Seconds) -> Array:
    """Return in which seconds the vehicle itself reports that it is disarmed or on the ground, shape (k,)."""
    disarmed = seconds.signals["state"][:, :, 2] == 0.0
    landed = seconds.signals["landed"][:, :, 0] == ON_GROUND
    return np.asarray((disarmed | landed).any(axis=1))


class FlightEvents:
    """The events of every vehicle of a log."""

    def __init__(self) -> None:
        self._vehicles: dict[int, VehicleEvents] = {}

    def of(self, vehicle: int) -> VehicleEvents:
        """Return the events of a vehicle."""
        return self._vehicles.setdefault(vehicle, VehicleEvents(vehicle))

    def feed(
        self, tables: Mapping[str, Table], start_us: int, admits: Callable[[int], bool]
    ) -> Iterator[tuple[int, float, str]]:
        """Take faults that devices report and readings of servo rails, of the vehicles that are admitted.

        Yields
        ------
        tuple
            Of a fault that is reported for the first time, and of a rail that begins to sag: vehicle, flight
            time, s, and words.
        """
        for vehicle, report in by_vehicle(tables, *FAULT_FACTS, RAIL):
            if not admits(vehicle):
                continue
            time_s = (report.table.time_us - start_us) / 1e6
            if report.source.fact == RAIL:
                for sag in self.of(vehicle).rail.feed(time_s, report.values[:, 0]):
                    least_v = SAGS_SHARE * sag.usual_v
                    words = f"the servo rail falls below {least_v:.1f} V: it feeds every surface"
                    yield vehicle, sag.start_s, words
                continue
            for at_s, words in self.of(vehicle).reported.hear(report, time_s):
                yield vehicle, at_s, words

    def finish(self) -> None:
        """End the input."""
        for one in self._vehicles.values():
            one.finish()

    def gathered(
        self, rotors: Set[int], mixed: Container[int | None] = ()
    ) -> tuple[tuple[FlightEvent, ...], int]:
        """Return the events of all vehicles in order of time, and how many of them are not kept.

        Parameters
        ----------
        rotors
            The vehicles that are carried by rotors alone.
        mixed
            The vehicles whose id several senders share: what one does looks like another's event.
        """
        found, left_out = list[FlightEvent](), 0
        for vehicle, one in self._vehicles.items():
            events = one.events(rotors=vehicle in rotors)
            found += [] if vehicle in mixed else events
            left_out += one.left_out + (len(events) if vehicle in mixed else 0)
        return tuple(sorted(found, key=lambda event: (event.time_s, event.vehicle, event.kind))), left_out
