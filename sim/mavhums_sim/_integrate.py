"""The integration kernels: one mass or two, with dry friction as an impulse or by Karnopp's method.

The current follows its exact exponential within each step, which is stable at any step, whereas an
explicit rule needs dt < 2L/R. Angles are integrated with the new speeds (symplectic Euler).
"""

from __future__ import annotations

from math import copysign
from typing import NamedTuple

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._compiled import kernel


class Constants(NamedTuple):
    """Constants of a flight; :class:`mavhums_sim.ema.EmaParameters` describes them and their units."""

    torque_per_ampere: float
    resistance: float
    inductance: float
    inertia: float
    viscous: float
    supply_voltage: float
    current_limit: float
    slew_limit: float
    stroke: float
    position_gain: float
    speed_gain: float
    integral_gain: float
    stiction_ratio: float
    karnopp_band: float
    output_inertia: float
    stiffness: float
    damping: float
    backlash: float
    rotor_friction: float
    load_friction: float


class Course(NamedTuple):
    """Inputs that vary during a flight: one value per control period, shape (n,) each, SI units."""

    command: Array
    friction: Array
    load_slope: Array
    load_offset: Array
    torque_factor: Array
    resistance_factor: Array
    speed_factor: Array
    sag: Array
    sensor_bias: Array
    backlash: Array
    jam: Array


class State(NamedTuple):
    """State of the actuator at the end of each control period, shape (n,) each, SI units."""

    angle: Array
    speed: Array
    rotor_angle: Array
    rotor_speed: Array
    current: Array
    voltage: Array
    load: Array


@kernel
def rub(
    speed: float, torque: float, kinetic: float, breakaway: float, inertia: float, dt: float, band: float
) -> float:
    """Return the speed after ``dt`` under a torque and dry friction.

    With ``band`` zero the friction is an impulse (Moreau): up to T_c·dt of momentum while moving, up
    to T_s·dt at rest. Otherwise it is Karnopp's: a speed below ``band`` counts as rest.
    """
    if band == 0.0:
        free = speed + dt * torque / inertia
        slip = kinetic * dt / inertia
        grip = breakaway * dt / inertia
        if abs(free) <= (grip if speed == 0.0 else slip):
            return 0.0
        return free - slip if free > 0.0 else free + slip
    if abs(speed) > band:
        return speed + dt * (torque - copysign(kinetic, speed)) / inertia
    if abs(torque) <= breakaway:
        return 0.0
    return speed + dt * (torque - copysign(breakaway, torque)) / inertia


@kernel
def mesh(twist: float, speed: float, half: float, stiffness: float, damping: float) -> float:
    """Return the torque of the teeth: zero inside the backlash ±``half``; teeth push and never pull."""
    if twist > half:
        return max(0.0, stiffness * (twist - half) + damping * speed)
    if twist < -half:
        return min(0.0, stiffness * (twist + half) + damping * speed)
    return 0.0


@kernel
def control(
    c: Constants,
    command: float,
    angle: float,
    speed: float,
    integral: float,
    course: tuple[float, float],
    period: float,
) -> tuple[float, float]:
    """Return the voltage for the next control period, and the integral after it.

    A position loop encloses a speed loop with back-EMF compensation; both are limited. The integral
    stops while the voltage saturates. The controller uses only the healthy constants. ``course`` is what is
    lost of the supply's voltage, and the factor on the speed that the controller asks for.
    """
    target = min(max(command, -c.stroke), c.stroke)
    wanted = course[1] * min(max(c.position_gain * (target - angle), -c.slew_limit), c.slew_limit)
    back_emf = c.torque_per_ampere * speed
    demand = c.speed_gain * (wanted - speed) + back_emf + integral
    supply = c.supply_voltage - course[0]
    low = max(-supply, back_emf - c.resistance * c.current_limit)
    high = min(supply, back_emf + c.resistance * c.current_limit)
    voltage = min(max(demand, low), high)
    if voltage == demand:
        integral += c.integral_gain * (wanted - speed) * period
    return voltage, integral


@kernel
def integrate_one_mass(dt: float, steps: int, c: Constants, course: Course) -> State:
    """Simulate a rigid actuator over a course, with ``steps`` of ``dt`` seconds per control period."""
    n = course.command.size
    out = np.empty((7, n))
    advance_one_mass(dt, steps, c, course, (0, n), np.zeros(6), out)
    return State(out[0], out[1], out[0], out[1], out[4], out[5], out[6])


@kernel
def integrate_two_masses(dt: float, steps: int, c: Constants, course: Course) -> State:
    """Simulate rotor and output shaft, coupled by a gear with play, over a course.

    ``c.inertia`` is the rotor's part; position feedback is from the output shaft, the speed from the rotor.
    """
    n = course.command.size
    out = np.empty((7, n))
    advance_two_masses(dt, steps, c, course, (0, n), np.zeros(6), out)
    return State(out[0], out[1], out[2], out[3], out[4], out[5], out[6])


@kernel
def advance_one_mass(
    dt: float, steps: int, c: Constants, course: Course, span: tuple[int, int], memory: Array, out: Array
) -> None:
    """Simulate a rigid actuator over several periods of a course.

    Parameters
    ----------
    span
        First period, and the one after the last.
    memory
        Angle, speed, rotor's angle and speed, current, integral; shape (6,); updated.
    out
        Rows of :class:`State`, shape (7, n); the columns of the span are filled.
    """
    angle, speed, _, _, current, integral = memory
    load = 0.0
    for k in range(span[0], span[1]):
        voltage, integral = control(
            c,
            course.command[k],
            angle + course.sensor_bias[k],
            speed,
            integral,
            (course.sag[k], course.speed_factor[k]),
            dt * steps,
        )
        torque_per_ampere = c.torque_per_ampere * course.torque_factor[k]
        resistance = c.resistance * course.resistance_factor[k]
        decay = np.exp(-resistance * dt / c.inductance)
        kinetic = course.friction[k] + course.jam[k]
        breakaway = c.stiction_ratio * course.friction[k] + course.jam[k]
        for _ in range(steps):
            steady = (voltage - torque_per_ampere * speed) / resistance
            current = steady + (current - steady) * decay
            load = course.load_slope[k] * angle + course.load_offset[k]
            torque = torque_per_ampere * current - load - c.viscous * speed
            pressed = c.load_friction * abs(load)
            speed = rub(
                speed,
                torque,
                kinetic + pressed,
                breakaway + c.stiction_ratio * pressed,
                c.inertia,
                dt,
                c.karnopp_band,
            )
            angle += speed * dt
        _note(out, k, (angle, speed, angle, speed, current, voltage, load))
    _remember(memory, (angle, speed, angle, speed, current, integral))


@kernel
def advance_two_masses(
    dt: float, steps: int, c: Constants, course: Course, span: tuple[int, int], memory: Array, out: Array
) -> None:
    """Simulate rotor and output shaft over several periods; parameters as in :func:`advance_one_mass`."""
    angle, speed, rotor, rotor_speed, current, integral = memory
    load = 0.0
    for k in range(span[0], span[1]):
        voltage, integral = control(
            c,
            course.command[k],
            angle + course.sensor_bias[k],
            rotor_speed,
            integral,
            (course.sag[k], course.speed_factor[k]),
            dt * steps,
        )
        torque_per_ampere = c.torque_per_ampere * course.torque_factor[k]
        resistance = c.resistance * course.resistance_factor[k]
        decay = np.exp(-resistance * dt / c.inductance)
        half = 0.5 * (c.backlash + course.backlash[k])
        rotor_friction = c.rotor_friction * course.friction[k]
        output_friction = course.friction[k] - rotor_friction
        output_kinetic = output_friction + course.jam[k]
        output_breakaway = c.stiction_ratio * output_friction + course.jam[k]
        for _ in range(steps):
            steady = (voltage - torque_per_ampere * rotor_speed) / resistance
            current = steady + (current - steady) * decay
            load = course.load_slope[k] * angle + course.load_offset[k]
            teeth = mesh(rotor - angle, rotor_speed - speed, half, c.stiffness, c.damping)
            torque = torque_per_ampere * current - teeth - c.viscous * rotor_speed
            pressed = c.load_friction * abs(load)
            rotor_pressed = c.rotor_friction * pressed
            pressed -= rotor_pressed
            rotor_speed = rub(
                rotor_speed,
                torque,
                rotor_friction + rotor_pressed,
                c.stiction_ratio * (rotor_friction + rotor_pressed),
                c.inertia,
                dt,
                c.karnopp_band,
            )
            speed = rub(
                speed,
                teeth - load,
                output_kinetic + pressed,
                output_breakaway + c.stiction_ratio * pressed,
                c.output_inertia,
                dt,
                c.karnopp_band,
            )
            rotor += rotor_speed * dt
            angle += speed * dt
        _note(out, k, (angle, speed, rotor, rotor_speed, current, voltage, load))
    _remember(memory, (angle, speed, rotor, rotor_speed, current, integral))


@kernel
def _note(out: Array, k: int, values: tuple[float, float, float, float, float, float, float]) -> None:
    out[0, k], out[1, k], out[2, k], out[3, k], out[4, k], out[5, k], out[6, k] = values


@kernel
def _remember(memory: Array, values: tuple[float, float, float, float, float, float]) -> None:
    memory[0], memory[1], memory[2], memory[3], memory[4], memory[5] = values
