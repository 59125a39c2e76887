"""Mapping of all vehicles in a log, each with its own airframe profile; V1–V12 of a whole log, as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mavhums.actuator.draft import Announcement, Draft, Drafts, announcements
from mavhums.actuator.mapping import MappedSamples, Mapper
from mavhums.actuator.profile import Airframe, ProfileError, load_airframe
from mavhums.actuator.telemetry import Tier, best_tier, tiers_by_content
from mavhums.core.quantities import KEYS
from mavhums.log import Log, Table
from mavhums.vehicle.clocks import Clocks

if TYPE_CHECKING:
    import pandas as pd


class VehicleMappers:
    """Follows the vehicles of a log, block after block.

    Parameters
    ----------
    airframe
        The profile for every vehicle; if None, each vehicle is mapped by the profile that it names, from
        there on, or else by one that is drafted from its parameters.

    Attributes
    ----------
    drafts
        The drafted profiles in use, by vehicle.
    """

    def __init__(self, airframe: Airframe | None = None) -> None:
        self._given = airframe
        self._mappers = [] if airframe is None else [Mapper(airframe)]
        self._told: set[tuple[int, str]] = set()
        self._drafting = Drafts()
        self.drafts: dict[int, Draft] = {}

    @property
    def airframes(self) -> list[str]:
        """Names of the profiles in use."""
        return list(dict.fromkeys(mapper.airframe.name for mapper in self._mappers))

    def listen(self, tables: Mapping[str, Table]) -> Iterator[tuple[Announcement, Airframe | None]]:
        """Yield the vehicles' profile messages, and the profile used; None if it is not known."""
        self._told |= tiers_by_content(tables)
        for said in announcements(tables):
            if self._given is None and (said.vehicle in self.drafts or self.mapper(said.vehicle) is None):
                if said.known:
                    self._drafting.give_up(said.vehicle)
                    if drafted := self.drafts.pop(said.vehicle, None):
                        self._mappers = [one for one in self._mappers if one.airframe is not drafted.airframe]
                    self._mappers.append(
                        Mapper(load_airframe(said.name), vehicle=said.vehicle, from_frame=said.frame)
                    )
                mapper = self.mapper(said.vehicle)
                yield said, mapper.airframe if mapper else None

    def draft(self, tables: Mapping[str, Table]) -> Iterator[Draft]:
        """Yield the profiles that are drafted with these messages; after :meth:`listen`."""
        if self._given is not None:
            return
        for draft in self._drafting.feed(tables):
            if self.mapper(draft.vehicle) is None:
                self.drafts[draft.vehicle] = draft
                self._mappers.append(Mapper(draft.airframe, vehicle=draft.vehicle, from_frame=draft.frame))
                yield draft

    def feed(
        self, tables: Mapping[str, Table], *, final: bool = False
    ) -> Iterator[tuple[Mapper, MappedSamples]]:
        """Yield the samples that these messages complete; ``final`` marks the end of the log."""
        mappers = self._mappers
        if len(mappers) > 1 and not final:
            speak = {system for table in tables.values() for system in np.unique(table.system).tolist()}
            mappers = [mapper for mapper in mappers if any(map(mapper.serves, speak))]
        for mapper in mappers:
            for mapped in mapper.feed(tables, final=final):
                yield mapper, mapped

    def mapper(self, vehicle: int | None) -> Mapper | None:
        """Return the mapper that serves a vehicle, if any."""
        return next((mapper for mapper in self._mappers if mapper.serves(vehicle)), None)

    def tier(self, vehicle: int | None, counts: Mapping[tuple[int, int, str], int]) -> Tier | None:
        """Return the richest tier of a vehicle, given the number of messages by (system, component, name)."""
        messages = {name for system, _, name in counts if system == vehicle}
        return best_tier(messages, {tier for told, tier in self._told if told == vehicle})


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """One actuator's quantities over a log.

    Attributes
    ----------
    frame
        V1…V12 by time (UTC); NaN where not measured.
    provenance
        Message field behind each quantity.
    """

    vehicle: int
    actuator: str
    frame: pd.DataFrame
    provenance: dict[str, str]


def actuators(
    log: Log, airframe: Airframe | str | None = None, *, vehicle: int | None = None
) -> dict[str, History]:
    """Return the histories of one vehicle's actuators, by actuator name.

    Parameters
    ----------
    log
        From ``read_log``.
    airframe
        A profile, its name or its path; if None, the one that the log names itself.
    vehicle
        System id; if None, the lowest that carries actuator telemetry.

    Raises
    ------
    ProfileError
        If no profile is given and the log names none.

    Examples
    --------
    >>> import mavhums
    >>> elevator = mavhums.actuators(mavhums.read_log("flight.tlog"))["elevator"]
    >>> list(elevator.frame.columns[:3])
    ['V1', 'V2', 'V3']
    >>> elevator.provenance["V5"]
    'DEBUG_FLOAT_ARRAY[EMA,3].data[4]'
    """
    if not isinstance(airframe, Airframe):
        named = (said.name for said in announcements(log.tables) if said.known)
        name = airframe if airframe is not None else next(named, None)
        if name is None:
            remedy = "name yours: `mavhums profile new LOG -o mine.toml` drafts it from the log's parameters"
            raise ProfileError(f"{log.path}: the log names no airframe profile", remedy)
        airframe = load_airframe(name)
    mapper = Mapper(airframe)
    mapped = mapper.feed(Clocks().feed(log.tables), final=True)
    if vehicle is None:
        vehicle = min((part.vehicle for part in mapped), default=0)
    parts: dict[str, list[MappedSamples]] = {}
    for part in mapped:
        if part.vehicle == vehicle:
            parts.setdefault(part.actuator.name, []).append(part)
    return {name: _history(mapper, several) for name, several in parts.items()}


def _history(mapper: Mapper, parts: list[MappedSamples]) -> History:
    import pandas as pd

    utc_us = np.concatenate([part.utc_us for part in parts])
    values = np.concatenate([part.values for part in parts])
    index = pd.DatetimeIndex(utc_us.astype("datetime64[us]"), tz="UTC", name="time")
    vehicle, actuator = parts[0].vehicle, parts[0].actuator
    frame = pd.DataFrame(values, columns=list(KEYS), index=index)
    return History(vehicle, actuator.name, frame, mapper.of(vehicle, actuator).provenance)
