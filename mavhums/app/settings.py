"""What the user's options name, read and checked once; only this travels on."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.app.options import History, Options
from mavhums.core.errors import MavhumsError
from mavhums.engine.options import EngineOptions
from mavhums.history.aircraft import Whose, hold_rule
from mavhums.history.aircraft_table import AircraftTable, load_aircraft_table
from mavhums.history.flights import FlightHistory, Since
from mavhums.history.index import IndexedFolder
from mavhums.history.stores import is_store
from mavhums.learn import Model, load_model, packaged_models
from mavhums.log.mavlink.signing import load_key

__all__ = ["Settings"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How logs are judged and what with, in memory.

    Attributes
    ----------
    engine
        Options of an engine that judges a flight alone: profile, models, key and the like.
    history
        The aircraft's earlier flights.
    since
        Dates from which they count, by actuator; None stands for all others.
    whose
        How the aircraft of a log is identified.
    """

    engine: EngineOptions
    history: History
    since: Since
    whose: Whose

    @classmethod
    def read(cls, options: Options | Settings | None) -> Settings:
        """Read the files that options name; settings are returned as they are, None is the defaults.

        Raises
        ------
        ProfileError, ModelError, KeyFileError, AircraftTableError
            If the profile, the model, the key or the table cannot be used.
        MavhumsError
            If there is no folder for the history, it is a fleet's store, or the rule cannot identify an
            aircraft.
        """
        if isinstance(options, Settings):
            return options
        given = options or Options()
        hold_rule(given.aircraft)
        airframe, key, table = given.airframe, given.key, given.aircraft_table
        engine = EngineOptions(
            airframe=airframe if isinstance(airframe, Airframe | None) else load_airframe(airframe),
            models=_models(given.model),
            decide=given.decide,
            false_alarms=given.false_alarms,
            dialect=given.dialect,
            key=key if isinstance(key, bytes | None) else load_key(key),
            vehicle_states=given.vehicle_states,
        )
        if not isinstance(table, AircraftTable):
            table = AircraftTable() if table is None else load_aircraft_table(table)
        whose = Whose(given.aircraft, table)
        return cls(engine=engine, history=_history(given.history), since=given.since or {}, whose=whose)

    def with_baselines(self, since: Since | None = None) -> EngineOptions:
        """Return the options of an engine that compares with the earlier flights while it judges.

        ``since`` replaces the dates from which they count.
        """
        since = self.since if since is None else since
        return replace(
            self.engine,
            baselines=partial(self.history.baselines, since=since),
            past=partial(self.history.past, since=since),
        )

    def with_vehicle_states(self) -> Settings:
        """Return settings by which the events also have what a recording or a report draws."""
        return replace(self, engine=replace(self.engine, vehicle_states=True))


def _models(model: Model | Sequence[Model] | str | Path | None) -> Sequence[Model]:
    if model is None:
        return packaged_models()
    if isinstance(model, str | Path):
        return (load_model(model),)
    return (model,) if isinstance(model, Model) else model


def _history(history: History | str | os.PathLike[str] | None) -> History:
    if isinstance(history, FlightHistory | IndexedFolder):
        return history
    if history is None:
        return FlightHistory()
    if is_store(history):
        problem = f"{history}: is a fleet's store, not a folder of one aircraft's flights"
        raise MavhumsError(problem, f"judge with the command: mavhums analyse LOG --history {history}")
    return IndexedFolder(history)
