"""The numbers that the paper publishes, and simulation of its eight conditions over the study's cyclograms.

The paper shows its cyclogram only in figures, so the study defines its own: a take-off, and a
pilot's, fixed before any training. Both use the airspeed of the simulator's take-off and PI control, without
sensor noise, because the paper's data are the output of a model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums_sim.cyclogram import Cyclogram, takeoff
from mavhums_sim.ema import EmaParameters
from mavhums_sim.motion import CONTROL_PERIOD_S, simulate
from mavhums_sim.sensors import SensorNoise, sample_times, sense

TABLE_1: Final = {
    "nominal torque, N·m": 3.5,
    "stall torque, N·m": 5.0,
    "no-load rotation speed, °/s": 100.0,
    "output stroke, ± °": 60.0,
    "supply voltage, V": 27.0,
    "nominal current, A": 0.85,
    "mass, kg": 0.36,
}

TRAINING_NM: Final = (0.225, 1.025)
TEST_NM: Final = (0.275, 0.325, 0.375, 0.875, 0.925, 0.975)
CONDITIONS: Final = (0.225, 0.275, 0.325, 0.375, 0.875, 0.925, 0.975, 1.025)
"""The second table 1 lists 1.025 as a test condition; the text and figures 16 to 19 train on it."""

FIGURES_16_TO_19: Final = {16: 0.225, 17: 0.375, 18: 1.025, 19: 0.875}
"""The friction of each figure, N·m."""

SELECTED: Final = ("V2", "V5", "V9", "V11")


class PublishedNetwork(NamedTuple):
    """A network of table 4 or 5: hidden neurons and accuracies, %."""

    hidden: int
    training: float
    test: float


TABLE_4: Final = (
    PublishedNetwork(11, 98.73, 93.96167),
    PublishedNetwork(16, 99.38, 96.70167),
    PublishedNetwork(12, 95.07, 92.41167),
    PublishedNetwork(11, 98.30, 95.02167),
    PublishedNetwork(10, 99.98, 94.79),
)
TABLE_5: Final = (
    PublishedNetwork(14, 99.985, 98.01),
    PublishedNetwork(15, 99.045, 95.14333),
    PublishedNetwork(11, 96.685, 95.405),
    PublishedNetwork(16, 99.79, 96.70667),
    PublishedNetwork(11, 96.68, 94.00167),
)
BEST_12: Final = 96.70
BEST_SELECTED: Final = 98.01

CHI_SQUARE: Final = {
    "V1": 40590.56,
    "V2": 41807.30,
    "V3": 41807.30,
    "V4": 19272.22,
    "V5": 19452.68,
    "V6": 14806.20,
    "V7": 115.80,
    "V8": 19452.68,
    "V9": 1811.61,
    "V10": 115.80,
    "V11": 10.22,
    "V12": 26.56,
}
P_LEVELS: Final = {"V11": 0.009165, "V12": 0.005362}
"""P-levels in figure 15; the paper gives the others as 0.000000."""

TAKEOFF = "take-off"
"""The paper's cyclogram, as far as its figures show it."""
PILOT = "pilot ±20°"

_DURATION_S = 100.0
_RATE_HZ = 100.0
_SURFACE = "elevator"
_HINGE_PER_DEFLECTION, _HINGE_PER_INCIDENCE = 0.016, 0.006
_AIR_DENSITY = 1.225
_MOVING_DEG_S = 1.0
_SEED = 0


@dataclass(frozen=True, eq=False)
class CyclogramSamples:
    """Samples of one condition over one cyclogram.

    Attributes
    ----------
    friction_nm
        Coulomb friction T_c.
    time_s
        Time of each sample, shape (n,).
    values
        V1…V12, shape (n, 12).
    moving
        Whether the output shaft turns at 1°/s or more, according to V10, shape (n,).
    moving_fraction
        Fraction of the time in which the shaft moved, from the simulator.
    """

    friction_nm: float
    time_s: Array
    values: Array
    moving: Flags
    moving_fraction: float


def _time() -> Array:
    time: Array = np.arange(1.0, round(_DURATION_S / CONTROL_PERIOD_S) + 1) * CONTROL_PERIOD_S
    return time


def _pilot() -> Array:
    """Return a random smooth command: 24 sines of 0.05 to 0.25 Hz, a 1/f power spectrum; peak ±20°."""
    random = np.random.default_rng(_SEED)
    frequency = np.exp(random.uniform(np.log(0.05), np.log(0.25), 24))
    shift = random.uniform(0, 2 * np.pi, 24)
    waves: Array = np.sin(2 * np.pi * frequency * _time()[:, None] + shift).sum(axis=1)
    waves *= np.clip(_time() / 2, 0, 1)
    command: Array = 20 * waves / np.abs(waves).max()
    return command


@cache
def _air() -> Cyclogram:
    """Return a take-off, whose gusts take longer to draw than its actuators to simulate."""
    return takeoff(_SEED, _DURATION_S)


def _takeoff() -> Array:
    command: Array = np.degrees(_air().commands[_SURFACE])
    return command


CYCLOGRAMS: dict[str, Callable[[], Array]] = {TAKEOFF: _takeoff, PILOT: _pilot}
"""The command of each cyclogram, °, one value per millisecond."""


@cache
def _flown(cyclogram: str, friction_nm: float, load_friction: float) -> CyclogramSamples:
    command, air = np.radians(CYCLOGRAMS[cyclogram]()), _air()
    pressure = 0.5 * _AIR_DENSITY * air.airspeed**2
    parameters = replace(EmaParameters.from_data_sheet(integral_gain=400.0), load_friction=load_friction)
    motion = simulate(
        parameters,
        command,
        np.full(command.size, friction_nm),
        pressure * _HINGE_PER_DEFLECTION,
        pressure * _HINGE_PER_INCIDENCE * air.incidence[_SURFACE],
    )
    random = np.random.default_rng(_SEED)
    times = sample_times(random, _DURATION_S, _RATE_HZ)
    values = sense(motion, parameters, times, random, SensorNoise.none())
    moving = np.abs(values[:, 9]) * 6 >= _MOVING_DEG_S
    return CyclogramSamples(friction_nm, times, values, moving, float(np.mean(motion.speed != 0)))


def fly_condition(
    cyclogram: str, frictions_nm: Sequence[float], load_friction: float = 0.0
) -> list[CyclogramSamples]:
    """Simulate a cyclogram of :data:`CYCLOGRAMS` at each friction; 10,000 samples each.

    The command and the sample times are the same at every friction, so neither reveals the class.
    ``load_friction`` is μ: the friction of the paper's EMA does not depend on its load.
    """
    return [_flown(cyclogram, friction, load_friction) for friction in frictions_nm]
