"""The integration kernel: exact exponential update of the current, implicit dry friction.

Friction is an impulse (Moreau): each step it takes up to T_c·dt of the momentum, and while the
shaft rests it withstands up to T_s·dt. That is stable at any step and needs no velocity band.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def integrate(
    dt: float,
    steps: int,
    torque_per_ampere: float,
    resistance: float,
    inductance: float,
    inertia: float,
    supply_voltage: float,
    current_limit: float,
    slew_limit: float,
    stroke: float,
    position_gain: float,
    speed_gain: float,
    integral_gain: float,
    stiction_ratio: float,
    command: Array,
    friction: Array,
    load_slope: Array,
    load_offset: Array,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return angle, speed, current, voltage and load after each control period, shape (n,) each."""
    n = command.size
    angle_out = np.empty(n)
    speed_out = np.empty(n)
    current_out = np.empty(n)
    voltage_out = np.empty(n)
    load_out = np.empty(n)
    decay = np.exp(-resistance * dt / inductance)
    angle = speed = current = integral = load = 0.0
    for k in range(n):
        target = min(max(command[k], -stroke), stroke)
        wanted = min(max(position_gain * (target - angle), -slew_limit), slew_limit)
        back_emf = torque_per_ampere * speed
        demand = speed_gain * (wanted - speed) + back_emf + integral
        low = max(-supply_voltage, back_emf - resistance * current_limit)
        high = min(supply_voltage, back_emf + resistance * current_limit)
        voltage = min(max(demand, low), high)
        if voltage == demand:
            integral += integral_gain * (wanted - speed) * dt * steps
        coulomb = friction[k]
        for _ in range(steps):
            steady = (voltage - torque_per_ampere * speed) / resistance
            current = steady + (current - steady) * decay
            load = load_slope[k] * angle + load_offset[k]
            free = speed + dt * (torque_per_ampere * current - load) / inertia
            hold = (stiction_ratio if speed == 0.0 else 1.0) * coulomb * dt / inertia
            speed = 0.0 if abs(free) <= hold else free - np.sign(free) * coulomb * dt / inertia
            angle += speed * dt
        angle_out[k] = angle
        speed_out[k] = speed
        current_out[k] = current
        voltage_out[k] = voltage
        load_out[k] = load
    return angle_out, speed_out, current_out, voltage_out, load_out
