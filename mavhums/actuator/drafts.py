"""Profiles for vehicles that name none, drafted while the log is read from the parameters that it carries.

Only telemetry that says which servo it is of needs no more than such a profile: the servo's own record,
V1–V12, and named values of a servo's number, whose meaning is a guess. An ESC may drive a propeller: which
one drives a servo only a profile of the user's tells.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from mavhums.actuator.draft import MOST_NAMES, drafted_airframe, is_guessed
from mavhums.actuator.profile import Airframe
from mavhums.actuator.tiers import TIERS
from mavhums.core.arrays import Flags, Integers
from mavhums.log import Table
from mavhums.log.base.tables import text_of
from mavhums.vehicle.formats import SERVO_SOURCES, messages_of, reports
from mavhums.vehicle.formats.base import Report
from mavhums.vehicle.parameters import Sent

__all__ = ["Draft", "Drafts"]

_SETTLED_US: Final = 5_000_000
"""A profile is drafted this long after the last parameter of an output and the first telemetry: a list of
parameters comes without longer breaks, and every named value that is sent once a second has come by then."""

_OF_OUTPUTS: Final = re.compile(r"(SERVO|PWM_|CA_SV|UAVCAN_SV).*")
_NAMING_TIERS: Final = frozenset(tier.name for tier in TIERS if tier.names_servo)
_NAMING: Final = tuple(source for source in SERVO_SOURCES if source.tier in _NAMING_TIERS)
_SCRIPTED: Final = messages_of("script value")
_READ: Final = messages_of("parameter") | _SCRIPTED | {source.message for source in _NAMING}
_MOST_VEHICLES: Final = 64  # that may still name a profile: each costs memory, and a sender can forge any
_FEW: Final = 4  # names in a notice


Places = tuple[Integers, Integers]
"""Frames and times of messages, in the order of the log."""


class Draft(NamedTuple):
    """A drafted profile, from a place in the log on, and the named values whose meaning it guesses."""

    vehicle: int
    frame: int
    time_us: int
    airframe: Airframe
    guesses: tuple[str, ...]

    @property
    def notice(self) -> str:
        """What the user must know of verdicts by this profile."""
        guessed = f"; what {_listed(self.guesses)} mean is guessed from these names" if self.guesses else ""
        return (
            "no profile was named: one is drafted from the log's parameters, without constants and limits"
            f"{guessed}; check it with `mavhums profile new LOG -o mine.toml`, then name it with --airframe"
        )


@dataclass(slots=True)
class _UnprofiledVehicle:
    """What a vehicle without a profile has sent: the times of its last parameter and its first telemetry."""

    parameter_us: int | None = None
    telemetry_us: int | None = None
    names: set[str] = field(default_factory=set)


class Drafts:
    """Follows the vehicles of a log, block after block."""

    def __init__(self) -> None:
        self._vehicles: dict[int, _UnprofiledVehicle] = {}
        self._sent = Sent()
        self._done: set[int] = set()

    def give_up(self, vehicle: int) -> None:
        """Draft no profile for a vehicle: it names one."""
        self._done.add(vehicle)
        self._vehicles.pop(vehicle, None)

    def feed(self, tables: Mapping[str, Table]) -> Iterator[Draft]:
        """Yield the profiles that can be drafted now."""
        fresh = {name: self._fresh(tables[name]) for name in _READ & tables.keys()}
        told = [*_of_outputs(fresh)]
        sent = {name: fresh[name].select(rows) for name, rows in _telemetry(fresh) if rows.any()}
        parts = [*(report.table for report in told), *sent.values()]
        systems = np.unique(np.concatenate([[], *(table.system for table in parts)])).astype(int)
        for vehicle in systems.tolist():
            if vehicle not in self._vehicles and len(self._vehicles) >= _MOST_VEHICLES:
                continue
            own = [report.select(report.table.system == vehicle) for report in told]
            draft = self._draft(vehicle, own, _own(sent, vehicle), tables)
            if draft is not None:
                self.give_up(vehicle)
                yield draft
        self._sent.take_autopilots(tables)

    def _fresh(self, table: Table) -> Table:
        """Return the messages of vehicles for which a profile may be drafted."""
        return table.select(~np.isin(table.system, [*self._done])) if self._done else table

    def _draft(
        self, vehicle: int, told: list[Report], sent: dict[str, Table], tables: Mapping[str, Table]
    ) -> Draft | None:
        """Take one vehicle's messages up to the first at which its profile can be drafted."""
        known = self._vehicles.setdefault(vehicle, _UnprofiledVehicle())
        frames, times = _in_order([*sent.values()])
        told_frames, told_us = _in_order([report.table for report in told])
        while True:
            place = _first_settled(known, (frames, times), (told_frames, told_us))
            until = np.iinfo(np.int64).max if place is None else int(frames[place])
            self._take(known, told, sent, until, tables)
            if place is None:
                return None
            parameters = self._sent.of(vehicle)
            airframe = drafted_airframe(parameters, known.names)
            if airframe is not None:
                guesses = tuple(sorted(name for name in known.names if is_guessed(name)))
                return Draft(vehicle, until, int(times[place]), airframe, guesses)
            later = told_frames[told_frames > until]  # no surface is named yet: with the next parameters
            if not later.size:
                known.parameter_us = None
                frames, times = frames[:0], times[:0]
                continue
            keep = frames > later[0]
            frames, times = frames[keep], times[keep]

    def _take(
        self,
        known: _UnprofiledVehicle,
        told: list[Report],
        sent: dict[str, Table],
        until: int,
        tables: Mapping[str, Table],
    ) -> None:
        self._sent.take_autopilots(tables, before=until)
        for report in told:
            new = report.select(report.table.frame < until)
            if len(new.table):
                self._sent.take_parameters(new)
                known.parameter_us = max(known.parameter_us or 0, int(new.table.time_us.max()))
        for name, table in sent.items():
            fresh = table.select(table.frame <= until)
            if len(fresh):
                first = int(fresh.time_us.min())
                known.telemetry_us = first if known.telemetry_us is None else min(known.telemetry_us, first)
            for report in reports({name: fresh}, "script value"):
                if len(known.names) < MOST_NAMES:
                    known.names.update(report.texts)


def _first_settled(known: _UnprofiledVehicle, sent: Places, told: Places) -> int | None:
    """Return the first row of telemetry long enough after the first one and after the last parameter."""
    frames, times = sent
    if not frames.size:
        return None
    first = int(times[0]) if known.telemetry_us is None else known.telemetry_us
    before = np.searchsorted(told[0], frames)
    none = np.iinfo(np.int64).max // 2  # without a parameter nothing is settled
    last = np.concatenate([[none if known.parameter_us is None else known.parameter_us], told[1]])
    latest = last[before]
    settled = np.flatnonzero((times - first >= _SETTLED_US) & (times - latest >= _SETTLED_US))
    return int(settled[0]) if settled.size else None


def _listed(names: tuple[str, ...]) -> str:
    """Name a few of the values."""
    few = ", ".join(names[:_FEW])
    return f"{few} and {len(names) - _FEW} more" if len(names) > _FEW else few


def _of_outputs(tables: Mapping[str, Table]) -> Iterator[Report]:
    """Yield the parameters of outputs."""
    for report in reports(tables, "parameter"):
        names = [text_of(name) for name in report.values["name"].tolist()]
        found = report.select(np.array([_OF_OUTPUTS.fullmatch(name) is not None for name in names]))
        if len(found.table):
            yield found


def _telemetry(tables: Mapping[str, Table]) -> Iterator[tuple[str, Flags]]:
    """Yield which messages are telemetry of a servo that they name."""
    for source in _NAMING:
        table = tables.get(source.message)
        if table is None:
            continue
        rows = np.ones(len(table), dtype=bool) if source.marked is None else source.marked(table)
        for report in reports({source.message: table}, "script value"):
            names, row = np.unique(report.values, return_inverse=True)
            guessed = [is_guessed(bytes(name).decode("ascii", "replace")) for name in names]
            rows = rows | np.array(guessed, dtype=bool)[row]
        yield source.message, rows


def _own(tables: Mapping[str, Table], vehicle: int) -> dict[str, Table]:
    own = {name: table.select(table.system == vehicle) for name, table in tables.items()}
    return {name: table for name, table in own.items() if len(table)}


def _in_order(tables: list[Table]) -> Places:
    """Return frames and times of messages, in the order of the log."""
    none = np.empty(0, dtype=np.int64)
    frames = np.concatenate([none, *(table.frame for table in tables)])
    times = np.concatenate([none, *(table.time_us for table in tables)])
    order = np.argsort(frames, kind="stable")
    return frames[order], times[order]
