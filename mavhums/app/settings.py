"""The user's options, and what they name: read and checked once, and only that travels on."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.core.about import __version__
from mavhums.core.errors import MavhumsError
from mavhums.engine.options import EngineOptions
from mavhums.flights.aircraft import AircraftResolver, AircraftTable, check_aircraft_rule, load_aircraft_table
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.learn import Model, load_model, packaged_models
from mavhums.log.mavlink.signing import load_key
from mavhums.results.sections import Decide

if TYPE_CHECKING:
    from mavhums.flights.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The options by which a log or a link is judged; :class:`Settings` has what they name.

    Attributes
    ----------
    airframe
        A profile, its name or its path; if None, the one that the log names.
    model
        A model, its packaged name or its file, or several models; if None, those that ship with mavhums.
    decide
        Who decides an actuator's friction: ``physics``; ``network``, where one is for its airframe; or
        ``both``: the physics decides, and a notice reports where the network disagrees. Without limits in the
        profile the physics cannot decide, and the network does.
    store
        A store of flights, its file or its address: those of the log's aircraft give each actuator's own
        baseline.
    keep
        Whether the log is put into the store; the first one creates it.
    aircraft
        Whose log it is: ``=NAME``, or how its path names its aircraft: ``folder``, or a regular expression
        with a group ``aircraft``.
    aircraft_table
        The operator's table of installed boards and actuators, or its file: it names the aircraft of a board,
        and the baseline of an actuator begins anew when it is swapped.
    false_alarms
        Accepted number of false alarms in 100 hours of an actuator or an axis.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    key
        A MAVLink 2 signing key of 32 bytes, or its file: only frames signed with it count.

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
    store: Store | str | os.PathLike[str] | None = None
    keep: bool = False
    aircraft: str | None = None
    aircraft_table: AircraftTable | str | os.PathLike[str] | None = None
    false_alarms: float = FALSE_ALARMS
    dialect: str | os.PathLike[str] | None = None
    key: bytes | str | os.PathLike[str] | None = None

    def resolved(self) -> EngineOptions:
        """Return the options of an engine that judges one flight, with every named file read.

        Raises
        ------
        ProfileError, ModelError, KeyFileError, AircraftTableError
            If the profile, the model, the key or the table cannot be used.
        MavhumsError
            If the rule cannot identify an aircraft.
        """
        return Settings.read(self).engine


class GivenOptions(TypedDict, total=False):
    """The fields of :class:`Options`, as keywords."""

    airframe: Airframe | str | Path | None
    model: Model | Sequence[Model] | str | Path | None
    decide: Decide
    store: Store | str | os.PathLike[str] | None
    keep: bool
    aircraft: str | None
    aircraft_table: AircraftTable | str | os.PathLike[str] | None
    false_alarms: float
    dialect: str | os.PathLike[str] | None
    key: bytes | str | os.PathLike[str] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How logs are judged and what with, in memory.

    Attributes
    ----------
    engine
        Options of an engine that judges a flight alone: profile, models, key and the like.
    store
        The flights that logs are compared with; None for none.
    keep
        Whether logs are put into the store.
    resolver
        How the aircraft of a log is identified.
    """

    engine: EngineOptions
    store: Store | None
    keep: bool
    resolver: AircraftResolver

    @classmethod
    def read(cls, options: Options | Settings | None, **given: Unpack[GivenOptions]) -> Settings:
        """Read the files that options name; settings are returned as they are, None is the defaults.

        Options that are ``given`` by name take the place of those of ``options``.

        Raises
        ------
        TypeError
            If there is no such option, or it is given beside settings, which were read before.
        ProfileError, ModelError, KeyFileError, AircraftTableError
            If the profile, the model, the key or the table cannot be used.
        MavhumsError
            If the store is a folder, there is none to keep logs in, or the rule cannot identify an aircraft.
        """
        if isinstance(options, Settings):
            if given:
                raise TypeError(
                    f"{', '.join(given)}: give it with the options of which the settings were read"
                )
            return options
        if not isinstance(options, Options | None):
            hint = 'analyse("flight.tlog", airframe="paper")'
            raise TypeError(f"options: {type(options).__name__} is no Options object; name an option: {hint}")
        wanted = replace(options or Options(), **given)
        check_aircraft_rule(wanted.aircraft)
        airframe, key, table = wanted.airframe, wanted.key, wanted.aircraft_table
        engine = EngineOptions(
            airframe=None if airframe is None else load_airframe(airframe),
            models=models_of(wanted.model),
            decide=wanted.decide,
            false_alarms=wanted.false_alarms,
            dialect=wanted.dialect,
            key=key if isinstance(key, bytes | None) else load_key(key),
        )
        if not isinstance(table, AircraftTable):
            table = AircraftTable() if table is None else load_aircraft_table(table)
        resolver = AircraftResolver(wanted.aircraft, table)
        store = _store(wanted.store)
        if wanted.keep and store is None:
            raise MavhumsError("there is no store to keep the flight in", "name one: its file or its address")
        return cls(engine=engine, store=store, keep=wanted.keep, resolver=resolver)

    def alone(self) -> Settings:
        """Return settings by which logs are compared with no other."""
        return replace(self, store=None, keep=False)

    def fingerprint(self) -> str:
        """Return the hash of everything besides the log that a judgement depends on."""
        engine, airframe = self.engine, self.engine.airframe
        content: dict[str, Any] = {
            "version": __version__,
            "airframe": airframe.model_dump_json() if isinstance(airframe, Airframe) else None,
            "models": [model.hash for model in engine.models],
            "false_alarms": engine.false_alarms,
            "dialect": None,
            "key": None if engine.key is None else hashlib.sha256(engine.key).hexdigest(),
            "decide": engine.decide,
        }
        if engine.dialect is not None:
            with Path(engine.dialect).open("rb") as file:
                content["dialect"] = hashlib.file_digest(file, "sha256").hexdigest()
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]

    def with_vehicle_states(self) -> Settings:
        """Return settings by which the events also have what a recording or a report draws."""
        return replace(self, engine=replace(self.engine, vehicle_states=True))


def models_of(model: Model | Sequence[Model] | str | Path | None) -> Sequence[Model]:
    """Return the models that the option names: those that ship with mavhums if None."""
    if model is None:
        return packaged_models()
    if isinstance(model, str | Path):
        return (load_model(model),)
    return (model,) if isinstance(model, Model) else model


def _store(place: Store | str | os.PathLike[str] | None) -> Store | None:
    if not isinstance(place, str | os.PathLike):
        return place
    from mavhums.flights.store import Store  # a log that is compared with no other needs no database

    return Store(place)
