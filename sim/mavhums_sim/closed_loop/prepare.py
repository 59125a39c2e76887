"""Draws a flight's inputs from its seeds: rigging, servos, faults, measurement errors, gusts."""

from __future__ import annotations

from dataclasses import astuple
from math import inf

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim.closed_loop.aircraft import FRAME_S, Aircraft
from mavhums_sim.closed_loop.frame import ERRORS, VEHICLE
from mavhums_sim.closed_loop.scenario import ClosedLoop, Confounder
from mavhums_sim.closed_loop.surfaces import FAULT, LAYOUTS, SERVO, Servo

_CRUISE, _CRUISE_HEIGHT_M = 25.0, 100.0
_GUST_FRAMES, _GUST_S = 10, 3.0
_WHITE = {"roll": 0.0, "pitch": 0.0, "p": 0.004, "q": 0.004, "r": 0.004, "airspeed": 0.25}
_SLOW = {"roll": 0.008, "pitch": 0.008, "p": 0.0, "q": 0.0, "r": 0.0, "airspeed": 0.3}
_SLOW_S = 20.0


def wander(rng: np.random.Generator, count: int, period_s: float, time_constant_s: float) -> Array:
    """Return a first-order Gauss–Markov process of unit variance, shape (count,)."""
    from scipy.signal import lfilter

    kept = float(np.exp(-period_s / time_constant_s))
    white = rng.standard_normal(count) * np.sqrt(1.0 - kept * kept)
    white[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -kept], white), dtype=np.float64)


def measurement_errors(seed: int, count: int) -> Array:
    """Return the errors of the autopilot's measurements, at 50 Hz, shape (count, 6)."""
    rng = np.random.default_rng([seed, 26])
    columns = [
        _WHITE[name] * rng.standard_normal(count) + _SLOW[name] * wander(rng, count, 2 * FRAME_S, _SLOW_S)
        for name in ERRORS
    ]
    return np.stack(columns, axis=1)


def servo_rows(flight: ClosedLoop) -> NDArray[np.void]:
    """Return the flight's servos, :data:`~mavhums_sim.closed_loop.surfaces.SERVO` rows."""
    streams = LAYOUTS[flight.layout].streams
    rows = [
        (*astuple(Servo() if flight.airframe is None else Servo.draw(flight.airframe, index)), *stream)
        for index, stream in enumerate(streams)
    ]
    return np.array(rows, dtype=SERVO)


def fault_rows(flight: ClosedLoop) -> NDArray[np.void]:
    """Return the faults, one row per surface; kind 0 is none."""
    of = {fault.surface: fault.row() for fault in flight.faults}
    return np.array(
        [of.get(name, (0, 0.0, inf, inf)) for name in LAYOUTS[flight.layout].surfaces], dtype=FAULT
    )


def vehicle_row(flight: ClosedLoop) -> NDArray[np.void]:
    """Return rigging, engine and failing sensors of a flight."""
    rng = np.random.default_rng([flight.airframe or 0, 27])
    dispersed = 0.0 if flight.airframe is None else 0.05
    of = {confounder.kind: confounder for confounder in flight.confounders}
    vehicle = np.zeros(1, dtype=VEHICLE)
    vehicle["rigged_elevator"] = Aircraft().trim(_CRUISE_HEIGHT_M, _CRUISE).elevator
    vehicle["thrust"] = 1.0 + dispersed * rng.standard_normal()
    vehicle["torque"] = 1.0
    vehicle["begin_s"] = flight.ground_s
    for kind, value in (("engine", "engine_left"), ("airspeed", "airspeed_reads"), ("gps", "gps_drift")):
        found = of.get(kind)
        vehicle[f"{kind}_at"] = found.at_s if found else inf
        vehicle[f"{kind}_until"] = found.until_s if found else inf
        vehicle[value] = found.value if found else 1.0
    return vehicle


class Gust:
    """The variable mean wind: ``next`` is the frame at which :meth:`step` returns the next wind."""

    def __init__(self, flight: ClosedLoop) -> None:
        towards = np.radians(flight.air.direction_deg) + np.pi
        self._mean = flight.air.wind * np.array([np.cos(towards), np.sin(towards)])
        found: list[Confounder] = [c for c in flight.confounders if c.kind == "wind"]
        self.next = -1
        if found:
            angle = np.random.default_rng([flight.seed, 28]).uniform(-np.pi, np.pi)
            self._change = found[0].value * np.array([np.cos(angle), np.sin(angle)])
            self._begin = round((found[0].at_s - flight.ground_s) / FRAME_S)
            self._end = round((min(found[0].until_s, 1e6) - flight.ground_s) / FRAME_S)
            self.next = max(self._begin, 0)

    def step(self) -> tuple[float, float]:
        """Return the current wind, m/s towards north and east, and set ``next``."""
        ramp = _GUST_S / FRAME_S
        share = min(max((self.next - self._begin) / ramp, 0.0), 1.0)
        share -= min(max((self.next - self._end) / ramp, 0.0), 1.0)
        if share == 1.0 and self.next < self._end:
            self.next = self._end
        else:
            self.next = self.next + _GUST_FRAMES if self.next < self._end + ramp else -1
        north, east = self._mean + share * self._change
        return float(north), float(east)
