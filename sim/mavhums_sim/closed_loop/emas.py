"""The EMA models in the loop: each one moves a control surface against its hinge moment."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._integrate import Constants, Course, State, advance_one_mass, advance_two_masses
from mavhums_sim.conditions import degrade
from mavhums_sim.cyclogram import SURFACES, Cyclogram
from mavhums_sim.flight import (
    HEALTHY_FRICTION_NM,
    HINGE_PER_DEFLECTION,
    Flight,
    FlightRecord,
    record_actuator,
)
from mavhums_sim.individuals import Individual
from mavhums_sim.motion import CONTROL_PERIOD_S, STEP_S, Degradation, Motion

_PERIODS = 10  # of control in a frame
_STEPS = round(CONTROL_PERIOD_S / STEP_S)


@dataclass(slots=True, eq=False)
class _Ema:
    """One actuator during the flight."""

    individual: Individual
    constants: Constants
    course: Course
    degradation: Degradation
    memory: Array
    out: Array


class Emas:
    """The four EMAs of a flight.

    Parameters
    ----------
    flight
        Conditions and telemetry of the EMAs; its cyclogram is not used.
    duration_s, ground_s
        Duration of the flight, and of its first part on the launcher, where the surfaces do not move.
    """

    def __init__(self, flight: Flight, duration_s: float, ground_s: float) -> None:
        self._flight = flight
        self._count = round(duration_s / CONTROL_PERIOD_S)
        self._at = round(ground_s / CONTROL_PERIOD_S)
        self._advance = advance_two_masses if flight.parameters.gearbox else advance_one_mass
        self._emas = [self._ema(index) for index in range(len(SURFACES))]
        for ema in self._emas:
            self._drive(ema, (0, self._at))

    def _ema(self, index: int) -> _Ema:
        individual, n = self._flight.individual(index), self._count
        surface = SURFACES[index]
        time_s = (np.arange(n, dtype=np.float64) + 1.0) * CONTROL_PERIOD_S
        conditions = self._flight.conditions.get(surface, ())
        healthy = HEALTHY_FRICTION_NM * individual.friction
        start, end = self._flight.friction_nm.get(surface, (healthy, healthy))
        added, degradation = degrade(conditions, time_s, individual.torque_constant)
        worn = [np.ascontiguousarray(getattr(degradation, field.name)) for field in fields(degradation)]
        worn[0] = np.broadcast_to(worn[0], (n,)).copy()
        course = Course(np.zeros(n), np.linspace(start, end, n) + added, np.zeros(n), np.zeros(n), *worn)
        constants = individual.parameters(self._flight.parameters).constants()
        return _Ema(individual, constants, course, degradation, np.zeros(6), np.empty((7, n)))

    def _drive(self, ema: _Ema, span: tuple[int, int]) -> None:
        self._advance(CONTROL_PERIOD_S / _STEPS, _STEPS, ema.constants, ema.course, span, ema.memory, ema.out)

    def step(self, demand: Array, pressure: float, streams: Array, shafts: Array) -> None:
        """Advance by one frame and set the shafts' angles.

        Parameters
        ----------
        demand
            Angles demanded, rad, shape (4,).
        pressure
            Dynamic pressure, Pa.
        streams
            Angles of the surfaces if they floated freely, rad, shape (4,).
        """
        span = (self._at, self._at + _PERIODS)
        for s, ema in enumerate(self._emas):
            slope = pressure * ema.individual.hinge * HINGE_PER_DEFLECTION
            ema.course.command[span[0] : span[1]] = demand[s]
            ema.course.load_slope[span[0] : span[1]] = slope
            ema.course.load_offset[span[0] : span[1]] = -slope * streams[s]
            self._drive(ema, span)
            shafts[s] = ema.memory[0]
        self._at = span[1]

    def record(self, flown: Cyclogram) -> FlightRecord:
        """Return the motion and the telemetry of each actuator over the flight."""
        flight = replace(self._flight, duration_s=self._at * CONTROL_PERIOD_S, cyclogram=flown)
        records = {
            surface: record_actuator(flight, index, self._motion(self._emas[index]))
            for index, surface in enumerate(SURFACES)
        }
        return FlightRecord(flight, flown, records)

    def commands(self) -> dict[str, Array]:
        """Return the angles commanded so far, rad, one per control period."""
        return {
            surface: self._emas[index].course.command[: self._at] for index, surface in enumerate(SURFACES)
        }

    def _motion(self, ema: _Ema) -> Motion:
        n = self._at
        time_s = (np.arange(n, dtype=np.float64) + 1.0) * CONTROL_PERIOD_S
        cut = Degradation(*(getattr(ema.course, field.name)[:n] for field in fields(Degradation)))
        state = State(*ema.out[:, :n])
        return Motion(time_s, ema.course.command[:n], *state, ema.course.friction[:n], cut)
