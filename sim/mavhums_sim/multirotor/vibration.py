"""How unbalanced rotors shake a multirotor: the force m·r·ω² of each turns with it, in their plane.

Beside it, both blades pass each arm twice a turn and shake the craft vertically, and the air and the frame
add a broad noise. All of it is computed at the sensor's own times, from phases integrated from the speeds.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums_sim.dataflash import Kind, records
from mavhums_sim.multirotor.flight import LOGGED_HZ, Flown

Array = NDArray[np.float64]
FULL_RPM: Final = 9000.0
_BLADES_UM: Final = 2.0  # vertical motion at twice the speed
_NOISE: Final = 1.0  # m/s², white, of each axis
_MOST: Final = 16 * 9.80665  # m/s², range of the sensor


def rotor_rpm(flown: Flown) -> Array:
    """Return the speed of each rotor, rev/min, shape (n, motors): by the root of its lagged thrust."""
    craft, event = flown.craft, flown.plan.event
    given = craft.hover * (flown.command / craft.hover) ** craft.exponent
    keep = np.exp(-1.0 / (LOGGED_HZ * craft.lag_s))
    for k in range(1, len(given)):
        given[k] += keep * (given[k - 1] - given[k])
    if not np.isnan(event.fault_s) and not event.by_propeller:
        given[flown.time_s >= event.fault_s, event.motor] *= 1.0 - event.loss
    rpm: Array = FULL_RPM * np.sqrt(given)
    return rpm


def shaken(flown: Flown, unbalance_um: Array, time_s: Array, rng: np.random.Generator) -> Array:
    """Return the specific force at some times, m/s², shape (n, 3).

    ``unbalance_um`` is each rotor's mass by its arm by the mass of the craft, micrometres.
    """
    speed = rotor_rpm(flown) * (2 * np.pi / 60)
    phase = np.cumsum(speed, axis=0) / LOGGED_HZ + rng.uniform(0, 2 * np.pi, speed.shape[1])
    force = np.stack([np.interp(time_s, flown.time_s, axis) for axis in flown.force.T], axis=1)
    force += rng.normal(0.0, _NOISE, force.shape)
    for k, spin in enumerate(flown.craft.frame.spins):
        angle, rate = (np.interp(time_s, flown.time_s, column[:, k]) for column in (phase, speed))
        force[:, 0] += unbalance_um[k] * 1e-6 * rate**2 * np.cos(angle)
        force[:, 1] += unbalance_um[k] * 1e-6 * rate**2 * np.sin(-spin * angle)
        force[:, 2] += _BLADES_UM * 1e-6 * rate**2 * np.cos(2 * angle + k)
    clipped: Array = np.clip(force, -_MOST, _MOST)
    return clipped


def raw_records(flown: Flown, unbalance_um: Array, rate_hz: float, seed: int) -> Kind:
    """Return one record for each sample of the accelerometer (ACC), a millisecond after it."""
    time_s = np.arange(0.0, flown.time_s[-1], 1.0 / rate_hz)
    force = shaken(flown, unbalance_um, time_s, np.random.default_rng([seed, 13]))
    kind = records("ACC", time_s + 1e-3, **{f"Acc{axis}": force[:, k] for k, axis in enumerate("XYZ")})
    kind.rows["SampleUS"] = kind.rows["TimeUS"] - np.uint64(1000)
    return kind


def esc_records(flown: Flown, rate_hz: float, seed: int) -> list[Kind]:
    """Return what each ESC reports: speed, to the time between two commutations (ESC)."""
    rng = np.random.default_rng([seed, 14])
    rpm = rotor_rpm(flown)
    kinds = []
    for k in range(rpm.shape[1]):
        time_s = np.arange(rng.uniform(0, 1 / rate_hz), flown.time_s[-1], 1 / rate_hz)
        speed = np.interp(time_s, flown.time_s, rpm[:, k]) * (1 + rng.normal(0.0, 0.002, time_s.size))
        kinds.append(records("ESC", time_s, Instance=k, RPM=speed, Volt=14.8, Curr=5.0, Temp=0.0))
    return kinds
