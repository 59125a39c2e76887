"""What sensors and telemetry see of an actuator: V1…V12 at jittered times, with noise.

Sampling at exact multiples of the control period would lock the samples' phase to the
controller's and bias every average; real links jitter, and so does this one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums_sim.ema import EmaParameters
from mavhums_sim.motion import Motion

__all__ = ["SensorNoise", "sample_times", "sense"]

Array = NDArray[np.float64]

_DEGREES = 180.0 / np.pi
_REV_MIN = 30.0 / np.pi


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviation of each sensor's white noise."""

    rotor_angle_deg: float = 0.5
    output_angle_deg: float = 0.02
    voltage_v: float = 0.05
    current_a: float = 0.005
    rotor_speed_rev_min: float = 1.0
    output_torque_nm: float = 0.02

    @classmethod
    def none(cls) -> SensorNoise:
        """Return perfect sensors."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def sample_times(rng: np.random.Generator, duration_s: float, rate_hz: float) -> Array:
    """Return about ``duration_s * rate_hz`` times, increasing, jittered by up to ±20 % of a period."""
    period = 1.0 / rate_hz
    count = int(duration_s * rate_hz)
    times: Array = (np.arange(count) + 0.5 + rng.uniform(-0.2, 0.2, count)) * period
    return times


def sense(
    motion: Motion, parameters: EmaParameters, times: Array, rng: np.random.Generator, noise: SensorNoise
) -> Array:
    """Return V1…V12 at ``times``, shape (n, 12), in the paper's units and signs.

    Products and quotients (V6, V8, V9, V10, V12) are formed from the sensed values, as the
    paper's are: V8 = k_t·V5, V10 = V7/N.
    """

    def read(signal: Array, deviation: float) -> Array:
        exact: Array = np.interp(times, motion.time_s, signal)
        return exact + deviation * rng.standard_normal(times.size)

    ratio = parameters.gear_ratio
    values = np.empty((times.size, 12))
    values[:, 0] = read(motion.command * _DEGREES, 0.0)
    values[:, 1] = read(motion.angle * (_DEGREES * ratio), noise.rotor_angle_deg)
    values[:, 2] = read(motion.angle * _DEGREES, noise.output_angle_deg)
    values[:, 3] = read(motion.voltage, noise.voltage_v)
    values[:, 4] = read(motion.current, noise.current_a)
    values[:, 5] = values[:, 3] * values[:, 4]
    values[:, 6] = read(motion.speed * (_REV_MIN * ratio), noise.rotor_speed_rev_min)
    values[:, 7] = values[:, 4] * (parameters.torque_per_ampere / ratio)
    values[:, 8] = values[:, 7] * values[:, 6] / _REV_MIN
    values[:, 9] = values[:, 6] / ratio
    values[:, 10] = read(motion.load, noise.output_torque_nm)
    values[:, 11] = values[:, 10] * values[:, 9] / _REV_MIN
    return values
