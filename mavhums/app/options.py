"""The options of a judgement, as the user gives them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.core.errors import MavhumsError
from mavhums.engine.options import EngineOptions
from mavhums.flights.aircraft import AircraftResolver, check_aircraft_rule
from mavhums.flights.aircraft_table import AircraftTable, Since, load_aircraft_table
from mavhums.flights.history import FlightHistory
from mavhums.flights.store import EarlierFlights, is_store
from mavhums.flights.stores.folder import FlightFolder
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.learn import Model, load_model, packaged_models
from mavhums.log.mavlink.signing import load_key
from mavhums.report.assessment import Decide

__all__ = ["History", "Options"]

History = EarlierFlights
"""The earlier flights: all of them in memory, or a folder of which only the new ones are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The options by which a log or a link is judged; :meth:`resolved` reads the named files.

    Attributes
    ----------
    airframe
        A profile, its name or its path; if None, the one that the log names.
    model
        A model, its packaged name or its file, or several models; if None, those that ship with mavhums.
    decide
        Who decides an actuator's friction: ``physics``; ``network``, where one is for its airframe; or
        ``both``: the physics decides, and where the network says otherwise is told. Without limits in the
        profile the physics cannot decide, and the network does.
    history
        The aircraft's earlier flights, or their folder; they provide each actuator's own baseline.
    since
        Dates from which earlier flights count, by actuator; None stands for all others.
    aircraft
        How a log's path names its aircraft: ``folder``, or a regular expression with a group ``aircraft``.
    aircraft_table
        The operator's table of installed boards and actuators, or its file: it names the aircraft of a board,
        and the baseline of an actuator begins anew when it is swapped.
    false_alarms
        Accepted number of false alarms in 100 hours of an actuator.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    key
        A MAVLink 2 signing key of 32 bytes, or its file: only frames signed with it count.
    vehicle_states
        Whether the events include attitude, position, flight mode, and what a network says of each sample,
        as a recording needs them.

    Examples
    --------
    >>> import mavhums
    >>> options = mavhums.Options(airframe="paper", false_alarms=0.1)
    >>> mavhums.analyse("flight.tlog", options).airframe
    'paper'
    """

    airframe: Airframe | str | Path | None = None
    model: Model | Sequence[Model] | str | Path | None = None
    decide: Decide = "physics"
    history: History | str | os.PathLike[str] | None = None
    since: Since | None = None
    aircraft: str | None = None
    aircraft_table: AircraftTable | str | os.PathLike[str] | None = None
    false_alarms: float = FALSE_ALARMS
    dialect: str | os.PathLike[str] | None = None
    key: bytes | str | os.PathLike[str] | None = None
    vehicle_states: bool = False

    def resolved(self) -> EngineOptions:
        """Return the engine's options, with every named file read.

        Raises
        ------
        ProfileError, ModelError, KeyFileError
            If the profile, the model or the key cannot be used.
        MavhumsError
            If there is no folder for the history.
        """
        airframe, key = self.airframe, self.key
        history = self.flights()
        return EngineOptions(
            airframe=airframe if isinstance(airframe, Airframe | None) else load_airframe(airframe),
            models=self.models(),
            decide=self.decide,
            baselines=partial(history.baselines, since=self.since),
            past=partial(history.past, since=self.since),
            false_alarms=self.false_alarms,
            dialect=self.dialect,
            key=key if isinstance(key, bytes | None) else load_key(key),
            vehicle_states=self.vehicle_states,
        )

    def whose(self) -> AircraftResolver:
        """Return the operator's knowledge of whose log it is.

        Raises
        ------
        AircraftTableError
            If the table cannot be used.
        MavhumsError
            If the rule cannot identify an aircraft.
        """
        check_aircraft_rule(self.aircraft)
        table = self.aircraft_table
        if table is None:
            return AircraftResolver(self.aircraft)
        read = table if isinstance(table, AircraftTable) else load_aircraft_table(table)
        return AircraftResolver(self.aircraft, read)

    def models(self) -> Sequence[Model]:
        """Return the networks that vote."""
        if self.model is None:
            return packaged_models()
        if isinstance(self.model, str | Path):
            return (load_model(self.model),)
        return (self.model,) if isinstance(self.model, Model) else self.model

    def flights(self) -> History:
        """Return the earlier flights, or an empty history.

        Raises
        ------
        MavhumsError
            If there is no folder for the history, or it is a fleet's store.
        """
        if self.history is None:
            return FlightHistory()
        if not isinstance(self.history, str | os.PathLike):
            return self.history
        if is_store(self.history):
            problem = f"{self.history}: is a fleet's store, not a folder of one aircraft's flights"
            raise MavhumsError(problem, "take the options that mavhums.fleet.against(log, store) returns")
        return FlightFolder(self.history)
