"""What a closed-loop flight is to be: aircraft, mission, air, faults, confounders."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Literal, get_args

from mavhums_sim.closed_loop.aircraft import Air
from mavhums_sim.closed_loop.mission import Mission
from mavhums_sim.closed_loop.surfaces import LAYOUTS, SurfaceFault
from mavhums_sim.flight import Flight

Flavour = Literal["ardupilot", "px4"]

CONFOUNDERS = {
    "engine": "share of the thrust that is left",
    "airspeed": "what the sensor reads, as a share of the truth",
    "wind": "m/s that the mean wind gains within 3 s, from a random side",
    "gps": "m/s at which the position drifts",
}
_LONGEST_EMA_S = 1800.0


@dataclass(frozen=True, slots=True)
class Confounder:
    """A disturbance that is not a surface fault: ``kind`` of :data:`CONFOUNDERS`, its value, and its time.

    Raises
    ------
    ValueError
        If the kind is unknown or the value is not a number.
    """

    kind: str
    value: float
    at_s: float
    until_s: float = inf

    def __post_init__(self) -> None:
        if self.kind not in CONFOUNDERS:
            raise ValueError(f"no confounder {self.kind!r}; there are {', '.join(CONFOUNDERS)}")
        if not (isfinite(self.value) and 0.0 <= self.at_s < self.until_s):
            raise ValueError(f"confounder {self.kind}: the value must be a number and the times in order")


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """Description of a closed-loop flight.

    Attributes
    ----------
    seed
        Seed of mission, turbulence, pilot and noise.
    airframe
        Seed of the individual: aerodynamics, servos, gains; None flies the published aircraft.
    duration_s
        Duration from power-on; during the first ``ground_s`` the aircraft is on the launcher.
    layout, flavour, mission, air
        Surfaces, message flavour, mission and air.
    faults, confounders
        At most one fault per surface; times count from power-on.
    emas
        Conditions and telemetry of the EMAs that move the surfaces; the conditions are
        :class:`~mavhums_sim.conditions.Condition`. Without it the servos are of reduced order.

    Raises
    ------
    ValueError
        If a value is impossible; the message names it.
    """

    seed: int = 0
    airframe: int | None = 0
    duration_s: float = 600.0
    ground_s: float = 12.0
    layout: str = "conventional"
    flavour: Flavour = "ardupilot"
    mission: Mission = "mixed"
    air: Air = field(default_factory=Air)
    faults: tuple[SurfaceFault, ...] = ()
    confounders: tuple[Confounder, ...] = ()
    emas: Flight | None = None

    def __post_init__(self) -> None:
        if self.layout not in LAYOUTS:
            raise ValueError(f"no layout {self.layout!r}; there are {', '.join(LAYOUTS)}")
        for name, choices in (("flavour", get_args(Flavour)), ("mission", get_args(Mission))):
            if getattr(self, name) not in choices:
                raise ValueError(f"no {name} {getattr(self, name)!r}; there are {', '.join(choices)}")
        if not 0.0 <= self.ground_s < self.duration_s - 10.0 or self.duration_s > 7200.0:
            raise ValueError("a flight lasts at least 10 s beyond its time on the ground, and at most 7200 s")
        if self.emas and (self.layout != "conventional" or self.duration_s > _LONGEST_EMA_S):
            raise ValueError(f"EMAs fly the conventional layout, up to {_LONGEST_EMA_S:g} s")
        surfaces = [fault.surface for fault in self.faults]
        for name in surfaces:
            if name not in LAYOUTS[self.layout].surfaces:
                there = ", ".join(LAYOUTS[self.layout].surfaces)
                raise ValueError(f"no surface {name!r} in layout {self.layout}; there are {there}")
        kinds = [confounder.kind for confounder in self.confounders]
        if len(set(surfaces)) < len(surfaces) or len(set(kinds)) < len(kinds):
            raise ValueError("one fault a surface, and one confounder of a kind")
