"""Further cyclograms: pre-flight check, cruise, turns, landing, gusts.

Like the take-off they depend only on their seed. The command of an autopilot with a dead band is constant
between corrections, so their moving fractions differ widely.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._signals import gusts, held, ramp
from mavhums_sim.cyclogram import SURFACES, Cyclogram, takeoff
from mavhums_sim.motion import CONTROL_PERIOD_S

DEAD_BAND_DEG = 0.4
"""Default step of the commands: an autopilot's. One of a servo pulse (1 µs) is 0.12°; 0 is smooth."""


def preflight(seed: int, duration_s: float = 100.0, dead_band_deg: float = DEAD_BAND_DEG) -> Cyclogram:
    """Return the pre-flight check: at rest, the aircraft moves each surface in turn to full deflection.

    Each surface moves twice to either side at 10…15 °/s, with rests in between; the others do not move.
    """
    rng, time = _begin(seed, duration_s)
    zero = np.zeros_like(time)
    degrees = dict.fromkeys(SURFACES, zero)
    share = duration_s / len(SURFACES)
    for turn, index in enumerate(rng.permutation(len(SURFACES))):
        travel = rng.uniform(20.0, 25.0)
        quarter = min(travel / rng.uniform(10.0, 15.0), 0.1 * share)
        rest = (0.9 * share - 8.0 * quarter) / 4.0
        lasting = quarter * np.array([1, 0, 2, 0, 2, 0, 2, 0, 1]) + rest * np.array(
            [0, 1, 0, 1, 0, 1, 0, 1, 0]
        )
        corners = (turn + 0.05) * share + np.concatenate([[0.0], np.cumsum(lasting)])
        levels = travel * np.array([0, 1, 1, -1, -1, 1, 1, -1, -1, 0])
        degrees[SURFACES[index]] = np.interp(time, corners, levels)
    still = dict.fromkeys(SURFACES, zero)
    return _flown("preflight", dead_band_deg, time, degrees, zero, still, zero, zero, zero + np.pi / 2)


def cruise(seed: int, duration_s: float = 100.0, dead_band_deg: float = DEAD_BAND_DEG) -> Cyclogram:
    """Return level flight at 28 m/s in light turbulence: small corrections, long rests."""
    rng, time = _begin(seed, duration_s)
    airspeed = 28.0 + 0.5 * gusts(rng, time, 0.05, 0.5)
    roll, pitch = (
        np.radians(1.5) * gusts(rng, time, 0.02, 0.2),
        np.radians(2.0 + 0.5 * gusts(rng, time, 0.02, 0.2)),
    )
    yaw = np.radians(90.0 + 3.0 * gusts(rng, time, 0.01, 0.05))
    degrees = {s: 1.2 * gusts(rng, time, 0.05, 0.4) for s in SURFACES}
    degrees["elevator"] = degrees["elevator"] - 3.0
    incidence = _incidence(rng, time, 3.0 + 0.0 * time, 1.0)
    return _flown("cruise", dead_band_deg, time, degrees, airspeed, incidence, roll, pitch, yaw)


def turns(seed: int, duration_s: float = 100.0, dead_band_deg: float = DEAD_BAND_DEG) -> Cyclogram:
    """Return steep coordinated turns to alternating sides at 30 m/s, with a bank of 40…50°."""
    rng, time = _begin(seed, duration_s)
    starts = np.arange(0.05, 0.9, 0.15) + rng.uniform(-0.01, 0.01, 6)
    sides = rng.choice([-1.0, 1.0]) * np.resize([1.0, -1.0], starts.size)
    enter = 2.5 / duration_s
    bank = np.zeros_like(time)
    for start, side in zip(starts, sides, strict=True):
        inside = ramp(time / duration_s, start, start + enter)
        outside = ramp(time / duration_s, start + 0.11, start + 0.11 + enter)
        bank += side * rng.uniform(40.0, 50.0) * (inside - outside)
    load_factor = 1.0 / np.cos(np.radians(bank))
    roll_rate = np.gradient(bank, time)
    airspeed = 30.0 - 2.0 * (load_factor - 1.0) + 0.5 * gusts(rng, time, 0.05, 0.5)
    degrees = {s: 2.0 * gusts(rng, time, 0.1, 0.8) for s in SURFACES}
    degrees["aileron_left"] = degrees["aileron_left"] + 0.4 * roll_rate
    degrees["elevator"] = degrees["elevator"] - 3.0 - 18.0 * (load_factor - 1.0)
    degrees["rudder"] = degrees["rudder"] + 0.15 * roll_rate + 0.08 * bank
    incidence = _incidence(rng, time, 4.0 * load_factor, 1.5)
    yaw = np.pi / 2 + np.cumsum(9.81 / airspeed * np.tan(np.radians(bank))) * CONTROL_PERIOD_S
    return _flown(
        "turns", dead_band_deg, time, degrees, airspeed, incidence, np.radians(bank), 0.0 * bank + 0.05, yaw
    )


def gusty(seed: int, duration_s: float = 100.0, dead_band_deg: float = DEAD_BAND_DEG) -> Cyclogram:
    """Return flight at 26 m/s through heavy gusts: large, fast, continuous corrections."""
    rng, time = _begin(seed, duration_s)
    airspeed = 26.0 + 2.5 * gusts(rng, time, 0.1, 1.5)
    roll, pitch = (np.radians(10.0) * gusts(rng, time, 0.05, 0.5) for _ in range(2))
    yaw = np.radians(90.0 + 8.0 * gusts(rng, time, 0.02, 0.1))
    degrees = {s: 7.0 * gusts(rng, time, 0.15, 1.5) for s in SURFACES}
    incidence = _incidence(rng, time, 4.0 + 0.0 * time, 5.0)
    return _flown("gusts", dead_band_deg, time, degrees, airspeed, incidence, roll, 0.3 * pitch, yaw)


def landing(seed: int, duration_s: float = 100.0, dead_band_deg: float = DEAD_BAND_DEG) -> Cyclogram:
    """Return an approach at 20 m/s, flare, touch-down and roll-out to standstill."""
    rng, time = _begin(seed, duration_s)
    phase = time / duration_s
    flare, braked, stopped = ramp(phase, 0.60, 0.66), ramp(phase, 0.68, 0.85), ramp(phase, 0.86, 0.88)
    airspeed = np.maximum((20.0 + 0.8 * gusts(rng, time, 0.05, 0.8)) * (1.0 - braked), 0.0)
    active = (1.0 - 0.6 * braked) * (1.0 - stopped)
    roll = np.radians(4.0 * gusts(rng, time, 0.03, 0.3) * (1.0 - flare))
    pitch = np.radians((-3.0 + 8.0 * flare) * (1.0 - braked))
    yaw = np.radians(90.0 + 3.0 * gusts(rng, time, 0.02, 0.1) * (1.0 - stopped))
    degrees = {s: 5.0 * gusts(rng, time, 0.1, 0.8) * active for s in SURFACES}
    degrees["elevator"] = degrees["elevator"] - (6.0 + 10.0 * flare) * (1.0 - stopped)
    incidence = _incidence(rng, time, 6.0 + 4.0 * flare, 2.0)
    return _flown("landing", dead_band_deg, time, degrees, airspeed, incidence, roll, pitch, yaw)


CYCLOGRAMS: dict[str, Callable[..., Cyclogram]] = {
    "preflight": preflight,
    "takeoff": takeoff,
    "cruise": cruise,
    "turns": turns,
    "gusts": gusty,
    "landing": landing,
}


def _begin(seed: int, duration_s: float) -> tuple[np.random.Generator, Array]:
    time = (np.arange(round(duration_s / CONTROL_PERIOD_S), dtype=np.float64) + 1.0) * CONTROL_PERIOD_S
    return np.random.default_rng([seed, 1]), time


def _incidence(rng: np.random.Generator, time: Array, mean: Array, gust_deg: float) -> dict[str, Array]:
    """Angle of attack at wing and tail, sideslip at the fin, rad."""
    return {
        s: np.radians((0.0 if s == "rudder" else 1.0) * mean + gust_deg * gusts(rng, time, 0.1, 2.0))
        for s in SURFACES
    }


def _flown(
    name: str,
    dead_band_deg: float,
    time: Array,
    degrees: dict[str, Array],
    airspeed: Array,
    incidence: dict[str, Array],
    roll: Array,
    pitch: Array,
    yaw: Array,
) -> Cyclogram:
    """Complete a cyclogram: dead band, travel limits, opposed ailerons, and altitude from pitch."""
    commands = {s: np.radians(np.clip(held(degrees[s], dead_band_deg), -25.0, 25.0)) for s in SURFACES}
    if name != "preflight":
        commands["aileron_right"] = -commands["aileron_left"]
    climbed = np.cumsum(airspeed * np.sin(pitch)) * CONTROL_PERIOD_S
    altitude = climbed - min(float(climbed.min()), 0.0)
    return Cyclogram(name, time, commands, airspeed, incidence, roll, pitch, yaw, altitude)
