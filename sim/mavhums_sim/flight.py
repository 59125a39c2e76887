"""One flight of an aircraft with four servo actuators, each in its own condition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mavhums_sim.cyclogram import SURFACES, Cyclogram, takeoff
from mavhums_sim.ema import EmaParameters
from mavhums_sim.motion import Motion, simulate
from mavhums_sim.sensors import SensorNoise, sample_times, sense

__all__ = ["HEALTHY_FRICTION_NM", "ActuatorRecord", "Flight", "FlightRecord", "fly"]

HEALTHY_FRICTION_NM = 0.225
_AIR_DENSITY = 1.225
_HINGE_PER_DEFLECTION = 0.016  # c_δ, m³/rad: about 2 N·m at 20° and 24 m/s
_HINGE_PER_INCIDENCE = 0.006  # c_α, m³/rad

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Flight:
    """What is to be flown.

    Attributes
    ----------
    seed
        Decides pilot, gusts, sampling and noise; nothing else does.
    friction_nm
        Coulomb friction at start and end of the flight, per surface; it grows linearly between
        them. Surfaces that are not named have the paper's healthy 0.225 N·m.
    rate_hz
        Sample rate of the actuator telemetry.
    """

    seed: int = 0
    duration_s: float = 100.0
    friction_nm: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rate_hz: float = 100.0
    noise: SensorNoise = field(default_factory=SensorNoise)
    parameters: EmaParameters = field(default_factory=EmaParameters.from_data_sheet)

    def __post_init__(self) -> None:
        unknown = set(self.friction_nm) - set(SURFACES)
        if unknown:
            raise ValueError(f"no surface {sorted(unknown)[0]!r}; there are {', '.join(SURFACES)}")
        if not 1.0 <= self.duration_s <= 36_000.0:
            raise ValueError(f"duration {self.duration_s} s is outside 1…36000 s")
        if not 1.0 <= self.rate_hz <= 500.0:
            raise ValueError(f"rate {self.rate_hz} Hz is outside 1…500 Hz")
        for surface, pair in self.friction_nm.items():
            if not all(np.isfinite(value) and value >= 0 for value in pair):
                raise ValueError(f"friction of {surface} must be a number of N·m, zero or more")


@dataclass(frozen=True, slots=True, eq=False)
class ActuatorRecord:
    """One actuator's flight: true motion, and V1…V12 as sensed, ``values`` of shape (n, 12)."""

    motion: Motion
    time_s: Array
    values: Array


@dataclass(frozen=True, slots=True, eq=False)
class FlightRecord:
    """A flight that was flown."""

    flight: Flight
    cyclogram: Cyclogram
    actuators: dict[str, ActuatorRecord]

    def truth(self) -> dict[str, object]:
        """Return the ground truth as plain data for ``truth.json``."""
        return {
            "seed": self.flight.seed,
            "duration_s": self.flight.duration_s,
            "cyclogram": self.cyclogram.name,
            "airframe": "paper",
            "actuators": {
                surface: {
                    "fault": "friction" if surface in self.flight.friction_nm else "none",
                    "friction_nm": {
                        "start": float(record.motion.friction[0]),
                        "end": float(record.motion.friction[-1]),
                    },
                    "moving_fraction": round(record.motion.moving_fraction, 4),
                }
                for surface, record in self.actuators.items()
            },
        }


def fly(flight: Flight) -> FlightRecord:
    """Fly a take-off and return what happened and what was sensed.

    Examples
    --------
    >>> record = fly(Flight(seed=1, duration_s=10.0, friction_nm={"elevator": (0.975, 0.975)}))
    >>> record.actuators["elevator"].values.shape
    (1000, 12)
    """
    cyclogram = takeoff(flight.seed, flight.duration_s)
    pressure = 0.5 * _AIR_DENSITY * cyclogram.airspeed**2
    actuators = {}
    for index, surface in enumerate(SURFACES):
        rng = np.random.default_rng([flight.seed, 2, index])
        start, end = flight.friction_nm.get(surface, (HEALTHY_FRICTION_NM, HEALTHY_FRICTION_NM))
        motion = simulate(
            flight.parameters,
            cyclogram.commands[surface],
            np.linspace(start, end, cyclogram.time_s.size),
            pressure * _HINGE_PER_DEFLECTION,
            pressure * _HINGE_PER_INCIDENCE * cyclogram.incidence[surface],
        )
        times = sample_times(rng, flight.duration_s, flight.rate_hz)
        values = sense(motion, flight.parameters, times, rng, flight.noise)
        actuators[surface] = ActuatorRecord(motion, times, values)
    return FlightRecord(flight, cyclogram, actuators)
