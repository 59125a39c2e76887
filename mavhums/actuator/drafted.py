"""Profiles for vehicles that name none, drafted while the log is read from the parameters that it carries.

Only telemetry that says which servo it is of needs no more than such a profile: CSRV, V1–V12, and named
values of a servo's number, whose meaning is a guess. An ESC may drive a propeller: which one drives a servo
only a profile of the user's tells.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.draft import drafted_airframe
from mavhums.actuator.named_guess import is_guessed
from mavhums.actuator.profile import Airframe
from mavhums.actuator.sources import csrv, instrumented, named
from mavhums.log import Table
from mavhums.vehicle.parameters import Sent

__all__ = ["Draft", "Drafts"]

_SETTLED_US: Final = 5_000_000
"""A profile is drafted this long after the last parameter of an output and the first telemetry: a list of
parameters comes without longer breaks, and every named value that is sent once a second has come by then."""

_PARAMETERS: Final = {"PARAM_VALUE": "param_id", "PARM": "Name", "parameter": "name"}
_OF_OUTPUTS: Final = re.compile(r"(SERVO|PWM_|CA_SV|UAVCAN_SV).*")
_NAMED: Final = "NAMED_VALUE_FLOAT"
_READ: Final = _PARAMETERS.keys() | csrv.MESSAGES | instrumented.MESSAGES | named.MESSAGES
_MOST_NAMES: Final = 1000
_MOST_VEHICLES: Final = 64
_FEW: Final = 4

Rows = NDArray[np.int64]


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
class _Vehicle:
    """What a vehicle without a profile has sent: the times of its last parameter and its first telemetry."""

    parameter_us: int | None = None
    telemetry_us: int | None = None
    names: set[str] = field(default_factory=set)


class Drafts:
    """Follows the vehicles of a log, block after block."""

    def __init__(self) -> None:
        self._vehicles: dict[int, _Vehicle] = {}
        self._sent = Sent()
        self._done: set[int] = set()

    def give_up(self, vehicle: int) -> None:
        """Draft no profile for a vehicle: it names one."""
        self._done.add(vehicle)
        self._vehicles.pop(vehicle, None)

    def feed(self, tables: Mapping[str, Table]) -> Iterator[Draft]:
        """Yield the profiles that can be drafted now."""
        fresh = {name: self._fresh(tables[name]) for name in _READ & tables.keys()}
        told = {name: _of_outputs(fresh[name], text) for name, text in _PARAMETERS.items() if name in fresh}
        sent = {name: fresh[name].select(rows) for name, rows in _telemetry(fresh) if rows.any()}
        parts = [*told.values(), *sent.values()]
        systems = np.unique(np.concatenate([[], *(table.system for table in parts)])).astype(int)
        for vehicle in systems.tolist():
            if vehicle not in self._vehicles and len(self._vehicles) >= _MOST_VEHICLES:
                continue
            draft = self._draft(vehicle, _own(told, vehicle), _own(sent, vehicle), tables)
            if draft is not None:
                self.give_up(vehicle)
                yield draft
        if "HEARTBEAT" in tables:
            self._sent.take({"HEARTBEAT": tables["HEARTBEAT"]})

    def _fresh(self, table: Table) -> Table:
        """Return the messages of vehicles for which a profile may be drafted."""
        return table.select(~np.isin(table.system, [*self._done])) if self._done else table

    def _draft(
        self, vehicle: int, told: dict[str, Table], sent: dict[str, Table], tables: Mapping[str, Table]
    ) -> Draft | None:
        """Take one vehicle's messages up to the first at which its profile can be drafted."""
        known = self._vehicles.setdefault(vehicle, _Vehicle())
        frames, times = _in_order(sent)
        told_frames, told_us = _in_order(told)
        while True:
            place = _first_settled(known, (frames, times), (told_frames, told_us))
            until = np.iinfo(np.int64).max if place is None else int(frames[place])
            self._take(known, told, sent, until, tables.get("HEARTBEAT"))
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
        known: _Vehicle,
        told: dict[str, Table],
        sent: dict[str, Table],
        until: int,
        heartbeats: Table | None,
    ) -> None:
        if heartbeats is not None:  # what an integer parameter means depends on the autopilot
            self._sent.take({"HEARTBEAT": heartbeats.select(heartbeats.frame < until)})
        for name, table in told.items():
            new = table.select(table.frame < until)
            if len(new):
                self._sent.take({name: new})
                known.parameter_us = max(known.parameter_us or 0, int(new.time_us.max()))
        for name, table in sent.items():
            new = table.select(table.frame <= until)
            if len(new):
                first = int(new.time_us.min())
                known.telemetry_us = first if known.telemetry_us is None else min(known.telemetry_us, first)
            if name == _NAMED and len(known.names) < _MOST_NAMES:
                known.names.update(new.texts("name"))


def _first_settled(known: _Vehicle, sent: tuple[Rows, Rows], told: tuple[Rows, Rows]) -> int | None:
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


def _of_outputs(table: Table, text: str) -> Table:
    told = [_OF_OUTPUTS.fullmatch(name) is not None for name in table.texts(text)]
    return table.select(np.array(told, dtype=bool))


def _telemetry(tables: Mapping[str, Table]) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield which messages are telemetry of a servo that they name."""
    for name in csrv.MESSAGES & tables.keys():
        yield name, np.ones(len(tables[name]), dtype=bool)
    for source in (instrumented, named):
        for name in source.MESSAGES & tables.keys() - {_NAMED}:
            yield name, source.is_marked(tables[name])
    if _NAMED in tables:
        table = tables[_NAMED]
        names, row = np.unique(table["name"], return_inverse=True)
        own = [is_guessed(bytes(name).decode("ascii", "replace")) for name in names]
        yield _NAMED, named.is_marked(table) | np.array(own, dtype=bool)[row]


def _own(tables: Mapping[str, Table], vehicle: int) -> dict[str, Table]:
    own = {name: table.select(table.system == vehicle) for name, table in tables.items()}
    return {name: table for name, table in own.items() if len(table)}


def _in_order(tables: Mapping[str, Table]) -> tuple[Rows, Rows]:
    """Return frames and times of messages, in the order of the log."""
    none = np.empty(0, dtype=np.int64)
    frames = np.concatenate([none, *(table.frame for table in tables.values())])
    times = np.concatenate([none, *(table.time_us for table in tables.values())])
    order = np.argsort(frames, kind="stable")
    return frames[order], times[order]
