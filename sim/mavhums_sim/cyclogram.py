"""Flight cyclograms: surface commands and air data over time.

A cyclogram depends only on its seed, never on the actuator's condition: a command that depends on the
condition would reveal the class to a classifier.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._signals import gusts, ramp
from mavhums_sim.motion import CONTROL_PERIOD_S

SURFACES = ("aileron_left", "aileron_right", "elevator", "rudder")


@dataclass(frozen=True, slots=True, eq=False)
class Cyclogram:
    """One flight, sampled each control period (1 ms); arrays of shape (n,).

    Attributes
    ----------
    name
        Kind of flight.
    time_s
        Flight time at the end of each control period.
    commands
        Commanded deflection of each surface, rad.
    airspeed
        Airspeed, m/s.
    incidence
        Local angle of attack (or sideslip) at each surface, rad.
    roll, pitch, yaw
        Attitude, rad.
    altitude
        Altitude above the runway, m.
    """

    name: str
    time_s: Array
    commands: dict[str, Array]
    airspeed: Array
    incidence: dict[str, Array]
    roll: Array
    pitch: Array
    yaw: Array
    altitude: Array

    def first(self, n: int) -> Cyclogram:
        """Return the first ``n`` control periods."""
        arrays: dict[str, Any] = {
            field.name: value[:n] if isinstance(value, np.ndarray) else {s: a[:n] for s, a in value.items()}
            for field in fields(self)
            if not isinstance(value := getattr(self, field.name), str)
        }
        return Cyclogram(self.name, **arrays)


def takeoff(seed: int, duration_s: float = 100.0) -> Cyclogram:
    """Return a take-off: control check, ground roll, rotation, climb through gusts, level-off.

    Phases are fixed fractions of the duration; the seed determines the pilot's corrections and the
    gusts. Surfaces move within about ±20°.
    """
    rng = np.random.default_rng([seed, 1])
    n = round(duration_s / CONTROL_PERIOD_S)
    time = (np.arange(n, dtype=np.float64) + 1.0) * CONTROL_PERIOD_S
    phase = time / duration_s

    airspeed = 24.0 * ramp(phase, 0.08, 0.24) + rng.normal(0, 0.3)
    airspeed = np.maximum(airspeed + 0.8 * gusts(rng, time, 0.05, 0.5) * ramp(phase, 0.2, 0.25), 0.0)
    climb = ramp(phase, 0.22, 0.28) - 0.8 * ramp(phase, 0.85, 0.92)
    pitch = np.radians(10.0 * climb + 1.5 * gusts(rng, time, 0.05, 0.4) * ramp(phase, 0.22, 0.26))
    roll = np.radians(8.0 * gusts(rng, time, 0.02, 0.3) * ramp(phase, 0.25, 0.3))
    yaw = np.radians(90.0 + 5.0 * gusts(rng, time, 0.01, 0.05))
    altitude = np.cumsum(airspeed * np.sin(np.maximum(pitch, 0.0)) * CONTROL_PERIOD_S)

    check = ramp(phase, 0.0, 0.005) * (1.0 - ramp(phase, 0.075, 0.08))
    activity = 5.0 + 3.0 * ramp(phase, 0.2, 0.24)
    trim = {"elevator": -6.0 * ramp(phase, 0.2, 0.23) + 3.0 * ramp(phase, 0.26, 0.3)}
    commands: dict[str, Array] = {}
    incidence: dict[str, Array] = {}
    for surface in SURFACES:
        sweep = 20.0 * np.sin(2 * np.pi * time / (0.04 * duration_s) + rng.uniform(0, 2 * np.pi)) * check
        corrections = activity * gusts(rng, time, 0.1, 1.0) * (1.0 - check)
        commands[surface] = np.radians(np.clip(sweep + corrections + trim.get(surface, 0.0), -25.0, 25.0))
        mean = 4.0 * climb if surface != "rudder" else 0.0
        incidence[surface] = np.radians(mean + 2.0 * gusts(rng, time, 0.1, 2.0))
    commands["aileron_right"] = -commands["aileron_left"]
    return Cyclogram("takeoff", time, commands, airspeed, incidence, roll, pitch, yaw, altitude)
