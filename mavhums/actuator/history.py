"""The quantities of each actuator over a whole log, as tables by time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mavhums.actuator.draft import announcements
from mavhums.actuator.mapping import MappedSamples, Mapper
from mavhums.actuator.profile import Airframe, ProfileError, load_airframe
from mavhums.core.quantities import KEYS
from mavhums.log import Log
from mavhums.vehicle.clocks import Clocks

if TYPE_CHECKING:
    import pandas as pd


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
