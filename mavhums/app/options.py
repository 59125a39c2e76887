"""The options of a judgement, as the user gives them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from mavhums.health.decision.limits import FALSE_ALARMS

if TYPE_CHECKING:
    from mavhums.actuator.profile import Airframe
    from mavhums.engine.options import EngineOptions
    from mavhums.history.aircraft_table import AircraftTable
    from mavhums.history.flights import FlightHistory, Since
    from mavhums.history.index import IndexedFolder
    from mavhums.learn import Model
    from mavhums.report.assessment import Decide

__all__ = ["History", "Options"]

History: TypeAlias = "FlightHistory | IndexedFolder"
"""The earlier flights: all of them in memory, or a folder of which only the needed ones are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The options by which a log or a link is judged; :class:`mavhums.app.settings.Settings` reads them.

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
        """Return the options of an engine that judges one flight, with every named file read.

        Raises
        ------
        ProfileError, ModelError, KeyFileError, AircraftTableError
            If the profile, the model, the key or the table cannot be used.
        MavhumsError
            If there is no folder for the history.
        """
        from mavhums.app.settings import Settings

        return Settings.read(self).with_baselines()

    def as_texts(self) -> dict[str, str | float]:
        """Return what differs from the defaults, as JSON holds it, for another process.

        Raises
        ------
        TypeError
            If an option is an object, not the name or the file of one.
        """
        texts: dict[str, str | float] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if value == field.default:
                continue
            if not isinstance(value, str | float | int | os.PathLike):
                raise TypeError(f"{field.name}: {type(value).__name__} is not a name or a file")
            texts[field.name] = os.fspath(value) if isinstance(value, os.PathLike) else value
        return texts
