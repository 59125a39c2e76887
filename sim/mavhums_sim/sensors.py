"""Sensors and telemetry of an actuator: V1…V12 at jittered times, with noise.

Sampling at exact multiples of the control period would lock the samples to the controller's phase
and bias every average; the sample times therefore have jitter, as on real links.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim.ema import EmaParameters
from mavhums_sim.motion import Motion

__all__ = ["ELECTRONICS_A", "EscSide", "SensorNoise", "sample_times", "sense", "sense_esc"]

EscSide = Literal["motor", "bus"]
ELECTRONICS_A = 0.05  # bus current of the electronics of one actuator


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
    count = int(duration_s * rate_hz)
    if not count:
        return np.empty(0)
    times: Array = (np.arange(count) + 0.5 + rng.uniform(-0.2, 0.2, count)) * (1.0 / rate_hz)
    return times


def sense(
    motion: Motion, parameters: EmaParameters, times: Array, rng: np.random.Generator, noise: SensorNoise
) -> Array:
    """Return V1…V12 at ``times``, shape (n, 12), in the paper's units and signs.

    Products and quotients (V6, V8, V9, V10, V12) are computed from the measured values, as in the
    paper: V8 = k_t·V5 with the data sheet's k_t, V10 = V7/N plus the motion of the elastic gear.
    V2 and V7 are the rotor's, V3 is from the output shaft's sensor with its bias.
    """

    def read(signal: Array, deviation: float | None) -> Array:
        exact: Array = np.interp(times, motion.time_s, signal)
        return exact if deviation is None else exact + deviation * rng.standard_normal(times.size)

    ratio = parameters.gear_ratio
    values = np.empty((times.size, 12))
    values[:, 0] = read(motion.command * _DEGREES, 0.0)
    values[:, 1] = read(motion.rotor_angle * (_DEGREES * ratio), noise.rotor_angle_deg)
    values[:, 2] = read((motion.angle + motion.degradation.sensor_bias) * _DEGREES, noise.output_angle_deg)
    values[:, 3] = read(motion.voltage, noise.voltage_v)
    values[:, 4] = read(motion.current, noise.current_a)
    values[:, 5] = values[:, 3] * values[:, 4]
    values[:, 6] = read(motion.rotor_speed * (_REV_MIN * ratio), noise.rotor_speed_rev_min)
    values[:, 7] = values[:, 4] * (parameters.torque_per_ampere / ratio)
    values[:, 8] = values[:, 7] * values[:, 6] / _REV_MIN
    values[:, 9] = values[:, 6] / ratio + read((motion.speed - motion.rotor_speed) * _REV_MIN, None)
    values[:, 10] = read(motion.load, noise.output_torque_nm)
    values[:, 11] = values[:, 10] * values[:, 9] / _REV_MIN
    return values


def sense_esc(
    motion: Motion,
    parameters: EmaParameters,
    times: Array,
    values: Array,
    rng: np.random.Generator,
    noise: SensorNoise,
    side: EscSide,
) -> Array:
    """Return voltage, V, current, A, and speed, rev/min, as the actuator's ESC reports them, shape (n, 3).

    On the ``motor`` side they are V4, V5 and V7. On the ``bus`` side the voltage is the supply minus
    its sag, and the current is the motor's, I = U_s·I_s/V_bus, plus that of the electronics; a braking
    motor feeds current back.
    """
    sensed = values[:, [3, 4, 6]].copy()
    if side == "bus":
        supply = parameters.supply_voltage - np.interp(times, motion.time_s, motion.degradation.sag)
        power = np.interp(times, motion.time_s, motion.voltage * motion.current)
        sensed[:, 0] = supply + noise.voltage_v * rng.standard_normal(times.size)
        sensed[:, 1] = power / supply + ELECTRONICS_A + noise.current_a * rng.standard_normal(times.size)
    return sensed
