"""V1–V12 of each actuator over a whole log, as tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mavhums.actuator.airframe_name import announcements
from mavhums.actuator.mapping import Mapped, Mapper
from mavhums.actuator.profile import Airframe, ProfileError, load_airframe, packaged_airframes
from mavhums.log import Log
from mavhums.quantities import KEYS

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["History", "actuators"]


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
    """
    if not isinstance(airframe, Airframe):
        named = (said.name for said in announcements(log.tables) if said.known)
        name = airframe if airframe is not None else next(named, None)
        if name is None:
            known = ", ".join(packaged_airframes())
            raise ProfileError(
                f"{log.path}: the log names no airframe profile", f"name one, for example: {known}"
            )
        airframe = load_airframe(name)
    mapper = Mapper(airframe)
    mapped = mapper.feed(log.tables)
    if vehicle is None:
        vehicle = min((part.vehicle for part in mapped), default=0)
    return {part.actuator.name: _history(mapper, part) for part in mapped if part.vehicle == vehicle}


def _history(mapper: Mapper, part: Mapped) -> History:
    import pandas as pd

    order = np.argsort(part.utc_us, kind="stable")
    index = pd.DatetimeIndex(part.utc_us[order].astype("datetime64[us]"), tz="UTC", name="time")
    frame = pd.DataFrame(part.values[order], columns=list(KEYS), index=index)
    return History(part.vehicle, part.actuator.name, frame, mapper.provenance(part.vehicle, part.actuator))
