"""One flight of an aircraft with four servo actuators, each in its own condition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim.conditions import Condition, degrade
from mavhums_sim.cyclogram import SURFACES, Cyclogram
from mavhums_sim.ema import EmaParameters
from mavhums_sim.individuals import Individual
from mavhums_sim.manoeuvres import CYCLOGRAMS
from mavhums_sim.motion import CONTROL_PERIOD_S, Motion, simulate
from mavhums_sim.rates import Rates
from mavhums_sim.sensors import (
    EscSide,
    Registers,
    SensorNoise,
    sample_times,
    sense,
    sense_esc,
    winding_temperature,
)

HEALTHY_FRICTION_NM = 0.225
_STUCK_LIMIT, _STUCK_RPM, _STUCK_S = 0.9, 20.0, 0.5  # share of the current limit; speed below; time
_AIR_DENSITY = 1.225
HINGE_PER_DEFLECTION = 0.016  # c_δ, m³/rad: about 2 N·m at 20° and 24 m/s
HINGE_PER_INCIDENCE = 0.006  # c_α, m³/rad


@dataclass(frozen=True, slots=True)
class Flight:
    """Description of a flight.

    Attributes
    ----------
    seed
        The only source of randomness of pilot, gusts, sampling and noise.
    duration_s
        Duration, s; the first part of a given :class:`Cyclogram` is used.
    friction_nm
        Coulomb friction at start and end of the flight, per surface; it grows linearly between
        them. Surfaces that are not named have their individual's, by default the paper's 0.225 N·m.
    rate_hz
        Sample rate of the actuator telemetry.
    parameters
        The type of actuator; with a gearbox it has two masses.
    cyclogram
        A name in :data:`mavhums_sim.manoeuvres.CYCLOGRAMS`, or a cyclogram.
    conditions
        Faults of each surface's actuator, besides ``friction_nm``.
    individuals
        Seed of the aircraft's individual actuators; None uses the data sheet's.
    esc_side
        Where the ESC measures: at the ``motor`` or at the supply ``bus``.
    rates
        Rates of the other messages.
    tiers
        Telemetry tiers of the actuators; see :mod:`mavhums_sim.tiers`.
    registers
        What a bus servo's registers make of the values of the tiers ``instrumented`` and ``named``; None
        for sensors as they are.

    Raises
    ------
    ValueError
        If a surface, cyclogram or number is impossible; the message names it.
    """

    seed: int = 0
    duration_s: float = 100.0
    friction_nm: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rate_hz: float = 100.0
    noise: SensorNoise = field(default_factory=SensorNoise)
    parameters: EmaParameters = field(default_factory=EmaParameters.from_data_sheet)
    cyclogram: str | Cyclogram = "takeoff"
    conditions: Mapping[str, tuple[Condition, ...]] = field(default_factory=dict)
    individuals: int | None = None
    esc_side: EscSide = "motor"
    rates: Rates = field(default_factory=Rates)
    tiers: tuple[str, ...] = ("instrumented", "esc-unsigned", "pwm")
    registers: Registers | None = None

    def __post_init__(self) -> None:
        unknown = (set(self.friction_nm) | set(self.conditions)) - set(SURFACES)
        if unknown:
            raise ValueError(f"no surface {sorted(unknown)[0]!r}; there are {', '.join(SURFACES)}")
        if not 1.0 <= self.duration_s <= 36_000.0:
            raise ValueError(f"duration {self.duration_s} s is outside 1…36000 s")
        if not 1.0 <= self.rate_hz <= 500.0:
            raise ValueError(f"rate {self.rate_hz} Hz is outside 1…500 Hz")
        for surface, pair in self.friction_nm.items():
            if not all(np.isfinite(value) and value >= 0 for value in pair):
                raise ValueError(f"friction of {surface} must be a number of N·m, zero or more")
        self._check_cyclogram()
        faults = {condition.fault for several in self.conditions.values() for condition in several}
        if "backlash" in faults and self.parameters.gearbox is None:
            raise ValueError("a rigid gear has no backlash; fly the two-mass model")

    def _check_cyclogram(self) -> None:
        if isinstance(self.cyclogram, str):
            if self.cyclogram not in CYCLOGRAMS:
                raise ValueError(f"no cyclogram {self.cyclogram!r}; there are {', '.join(CYCLOGRAMS)}")
        elif self.cyclogram.time_s.size < round(self.duration_s / CONTROL_PERIOD_S):
            lasts = self.cyclogram.time_s[-1]
            raise ValueError(f"{self.cyclogram.name} lasts {lasts:g} s, less than {self.duration_s:g} s")

    def fly_cyclogram(self) -> Cyclogram:
        """Return the cyclogram: commands and air data."""
        if isinstance(self.cyclogram, str):
            return CYCLOGRAMS[self.cyclogram](self.seed, self.duration_s)
        return self.cyclogram.first(round(self.duration_s / CONTROL_PERIOD_S))

    def individual(self, index: int) -> Individual:
        """Return the individual actuator of surface ``index``."""
        return Individual() if self.individuals is None else Individual.draw(self.individuals, index)


@dataclass(frozen=True, slots=True, eq=False)
class ActuatorRecord:
    """One actuator's flight.

    Attributes
    ----------
    motion
        The true motion.
    time_s, values
        Sample times, shape (n,), and V1…V12 as sensed, shape (n, 12).
    esc
        Voltage, current and speed at the ESC's side, shape (n, 3).
    individual, conditions
        The individual actuator, and its conditions.
    """

    motion: Motion
    time_s: Array
    values: Array
    esc: Array
    individual: Individual
    conditions: tuple[Condition, ...]

    def temperature(self, parameters: EmaParameters, times: Array) -> Array:
        """Return the winding's temperature at other times, °C; the parameters are the type's."""
        heated = winding_temperature(self.motion, self.individual.parameters(parameters))
        return np.interp(times, self.motion.time_s, heated)

    def stuck(self, parameters: EmaParameters, times: Array) -> NDArray[np.bool_]:
        """Return whether the ESC calls its motor stuck at other times: it has current, and does not move."""
        amperes, speed = np.abs(self.esc[:, 1:]).T
        held = (amperes >= _STUCK_LIMIT * parameters.current_limit) & (speed < _STUCK_RPM)
        free_s = np.maximum.accumulate(np.where(held, -np.inf, self.time_s))
        stuck: NDArray[np.bool_] = self.time_s - free_s >= _STUCK_S
        return stuck[np.clip(np.searchsorted(self.time_s, times, side="right") - 1, 0, None)]

    def truth(self, fault: str) -> dict[str, object]:
        """Return the ground truth of this actuator as plain data."""
        return {
            "fault": fault,
            "friction_nm": {"start": float(self.motion.friction[0]), "end": float(self.motion.friction[-1])},
            "moving_fraction": round(self.motion.moving_fraction, 4),
            "peak_load_nm": round(float(np.abs(self.motion.load).max()), 3),
            "conditions": [condition.truth() for condition in self.conditions],
            "individual": self.individual.truth(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class FlightRecord:
    """The record of a simulated flight."""

    flight: Flight
    cyclogram: Cyclogram
    actuators: dict[str, ActuatorRecord]

    def truth(self) -> dict[str, object]:
        """Return the ground truth as plain data for ``truth.json``."""
        flight = self.flight
        return {
            "seed": flight.seed,
            "duration_s": flight.duration_s,
            "cyclogram": self.cyclogram.name,
            "airframe": "paper",
            "model": "two-mass" if flight.parameters.gearbox else "single-mass",
            "esc_side": flight.esc_side,
            "tiers": list(flight.tiers),
            "actuators": {
                surface: record.truth(self._fault(surface)) for surface, record in self.actuators.items()
            },
        }

    def _fault(self, surface: str) -> str:
        faults = ["friction"] if surface in self.flight.friction_nm else []
        faults += [c.fault for c in self.flight.conditions.get(surface, ()) if c.fault not in faults]
        return "+".join(faults) or "none"


def fly(flight: Flight) -> FlightRecord:
    """Simulate a flight; return the true motion and the sensor values.

    Hinge moment: T_ext = ½·ρ·V²·(c_δ·δ + c_α·α).

    Examples
    --------
    >>> record = fly(Flight(seed=1, duration_s=10.0, friction_nm={"elevator": (0.975, 0.975)}))
    >>> record.actuators["elevator"].values.shape
    (1000, 12)
    """
    cyclogram = flight.fly_cyclogram()
    actuators = {surface: _actuate(flight, cyclogram, index) for index, surface in enumerate(SURFACES)}
    return FlightRecord(flight, cyclogram, actuators)


def _actuate(flight: Flight, cyclogram: Cyclogram, index: int) -> ActuatorRecord:
    surface = SURFACES[index]
    individual = flight.individual(index)
    conditions = flight.conditions.get(surface, ())
    healthy = HEALTHY_FRICTION_NM * individual.friction
    start, end = flight.friction_nm.get(surface, (healthy, healthy))
    added, degradation = degrade(conditions, cyclogram.time_s, individual.torque_constant)
    pressure = 0.5 * _AIR_DENSITY * cyclogram.airspeed**2 * individual.hinge
    motion = simulate(
        individual.parameters(flight.parameters),
        cyclogram.commands[surface],
        np.linspace(start, end, cyclogram.time_s.size) + added,
        pressure * HINGE_PER_DEFLECTION,
        pressure * HINGE_PER_INCIDENCE * cyclogram.incidence[surface],
        degradation,
    )
    return record_actuator(flight, index, motion)


def record_actuator(flight: Flight, index: int, motion: Motion) -> ActuatorRecord:
    """Return the record of the actuator of surface ``index``: motion, sensor values and telemetry."""
    rng = np.random.default_rng([flight.seed, 2, index])
    times = sample_times(rng, flight.duration_s, flight.rate_hz)
    values = sense(motion, flight.parameters, times, rng, flight.noise)
    rng = np.random.default_rng([flight.seed, 7, index])
    esc = sense_esc(motion, flight.parameters, times, values, rng, flight.noise, flight.esc_side)
    conditions = flight.conditions.get(SURFACES[index], ())
    if flight.registers:
        rng = np.random.default_rng([flight.seed, 13, index])
        kept, read = flight.registers.read(times, values, flight.parameters.gear_ratio, rng)
        times, values, esc = kept, read, esc[np.searchsorted(times, kept)]
    return ActuatorRecord(motion, times, values, esc, flight.individual(index), conditions)
