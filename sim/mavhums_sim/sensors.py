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
from mavhums_sim.motion import CONTROL_PERIOD_S, Motion

EscSide = Literal["motor", "bus"]
ELECTRONICS_A = 0.05  # bus current of the electronics of one actuator


AMBIENT_C = 35.0
_HEATING_K_PER_W, _HEATING_S = 8.0, 300.0
"""Of a winding to its housing: rise per watt at rest, and time constant."""

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


_READ = [0, 2, 3, 4, 6]  # V1, V3, V4, V5 and V7: what a bus servo reports


@dataclass(frozen=True, slots=True)
class Registers:
    """What a bus servo's registers make of its sensors; the defaults are those of an STS3215.

    Attributes
    ----------
    angle_step_deg, voltage_step_v, current_step_a
        Steps of V3, V4 and V5; 0 for none.
    speed_step_rad_s
        Step of V7 at the output shaft, rad/s, times the gear ratio.
    speed_lag_s
        By which V7 is late.
    current_hold_s
        For which V5 repeats itself; it has no sign. 0 leaves it as it is, with its sign.
    lost
        Share of the samples that are not read.
    """

    angle_step_deg: float = 360.0 / 4096.0
    voltage_step_v: float = 0.001 * 27.0  # duty in thousandths of the supply
    current_step_a: float = 0.0065
    speed_step_rad_s: float = 0.0767
    speed_lag_s: float = 0.01
    current_hold_s: float = 1.0
    lost: float = 0.01

    def read(
        self, times: Array, values: Array, gear_ratio: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return times and V1…V12 as read from the registers; what they do not hold is NaN.

        Examples
        --------
        >>> times, values = np.arange(300) * 0.01, np.full((300, 12), 0.0501)
        >>> read, left = Registers().read(times, values, 100.0, np.random.default_rng(1))
        >>> bool(290 < read.size < 300), float(left[0, 2]), bool(np.isnan(left[0, 1]))
        (True, 0.087890625, True)
        """
        left = np.full_like(values, np.nan)
        left[:, _READ] = values[:, _READ]
        left[:, 6] = np.interp(times - self.speed_lag_s, times, values[:, 6])
        if self.current_hold_s:
            second = np.floor(times / self.current_hold_s)
            left[:, 4] = np.abs(values[np.searchsorted(second, second), 4])
        steps = {
            2: self.angle_step_deg,
            3: self.voltage_step_v,
            4: self.current_step_a,
            6: self.speed_step_rad_s * _REV_MIN * gear_ratio,
        }
        for column, step in steps.items():
            if step:
                left[:, column] = np.rint(left[:, column] / step) * step
        kept = rng.random(times.size) >= self.lost
        return times[kept], left[kept]


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


def winding_temperature(motion: Motion, parameters: EmaParameters) -> Array:
    """Return the temperature of the winding, °C, which I²·R heats: τ·dϑ/dt = R_th·I²·R − ϑ, shape (n,).

    A constant current approaches ϑ = R_th·I²·R above the ambient temperature with the time constant τ.
    """
    from scipy.signal import lfilter

    watts = motion.current**2 * (parameters.resistance * motion.degradation.resistance_factor)
    step = 1.0 - np.exp(-CONTROL_PERIOD_S / _HEATING_S)
    warmer: Array = lfilter([step], [1.0, step - 1.0], _HEATING_K_PER_W * watts)
    return AMBIENT_C + warmer
