"""The options of the engine, in one object for every caller."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mavhums.actuator.profile import Airframe
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.results.sections import Decide

if TYPE_CHECKING:
    from mavhums.learn import Model


@dataclass(frozen=True, slots=True)
class EngineOptions:
    """The options by which the engine judges.

    Attributes
    ----------
    airframe
        The profile for every vehicle, its name or its path; if None, each vehicle is judged by the profile
        that it names.
    models
        Networks that answer beside the physics. An actuator uses the first network for its airframe whose
        quantities its samples contain.
    decide
        Who decides an actuator's friction: the physics, a network where one is for its airframe, or both.
        With ``both`` the physics decides, and a notice reports where the network disagrees.
    false_alarms
        Accepted number of false alarms in 100 hours of an actuator or an axis.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    key
        32 bytes; only frames signed with it count. If None, signatures are not checked.
    vehicle_states
        Whether attitude, position, flight mode, and what a network says of each sample, are reported as
        well, for a recording.

    Examples
    --------
    >>> from mavhums import Engine
    >>> engine = Engine(EngineOptions(airframe="paper"))
    """

    airframe: Airframe | str | Path | None = None
    models: Sequence[Model] = ()
    decide: Decide = "physics"
    false_alarms: float = FALSE_ALARMS
    dialect: str | os.PathLike[str] | None = None
    key: bytes | None = None
    vehicle_states: bool = False
