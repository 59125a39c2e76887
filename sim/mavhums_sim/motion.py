"""The motion of an actuator under a command, a load and a degradation."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import radians

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._integrate import Course, integrate_one_mass, integrate_two_masses
from mavhums_sim.ema import EmaParameters

CONTROL_PERIOD_S = 1e-3
STEP_S = 1e-4
MOVING_RAD_S = radians(0.1)  # slower motion is the controller's final creep into friction


@dataclass(frozen=True, slots=True, eq=False)
class Degradation:
    """Deviations of an actuator from its healthy constants over time; arrays of shape (n,).

    Attributes
    ----------
    torque_factor, resistance_factor
        Factors on N·k_t (and thus on the back-EMF) and R.
    speed_factor
        Factor on the speed that the controller asks for: on its gain and its rate limit.
    sag
        Supply voltage lost, V.
    sensor_bias
        Error of the output shaft's position sensor, rad; the controller uses the sensor.
    backlash
        Additional play of the gearbox, rad.
    jam
        Torque that holds the output shaft, N·m, at rest and in motion.
    """

    torque_factor: Array
    resistance_factor: Array
    speed_factor: Array
    sag: Array
    sensor_bias: Array
    backlash: Array
    jam: Array

    @classmethod
    def none(cls, n: int) -> Degradation:
        """Return the healthy course of ``n`` control periods."""
        return cls(*(np.ones(n) for _ in range(3)), *(np.zeros(n) for _ in range(4)))


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of an actuator, one row per control period (1 ms); every array has shape (n,).

    Attributes
    ----------
    command, angle
        Commanded and true angle of the output shaft, rad.
    speed
        Speed of the output shaft, rad/s; exactly zero while friction holds the shaft.
    rotor_angle, rotor_speed
        Angle and speed of the rotor divided by the gear ratio; with a rigid gear, equal to the output
        shaft's.
    current, voltage
        Current and voltage at the motor's terminals, A and V.
    load
        Hinge moment T_ext, N·m, positive against motion towards positive angles.
    friction
        Coulomb friction T_c, N·m.
    degradation
        All other deviations from a healthy actuator.
    """

    time_s: Array
    command: Array
    angle: Array
    speed: Array
    rotor_angle: Array
    rotor_speed: Array
    current: Array
    voltage: Array
    load: Array
    friction: Array
    degradation: Degradation

    @property
    def moving_fraction(self) -> float:
        """Fraction of the time in which the output shaft is faster than :data:`MOVING_RAD_S`."""
        return float(np.mean(np.abs(self.speed) > MOVING_RAD_S))


def simulate(
    parameters: EmaParameters,
    command: Array,
    friction: Array,
    load_slope: Array,
    load_offset: Array,
    degradation: Degradation | None = None,
    *,
    control_period_s: float = CONTROL_PERIOD_S,
    step_s: float = STEP_S,
) -> Motion:
    """Simulate an actuator over a cyclogram, from rest.

    Parameters
    ----------
    parameters
        Constants of the actuator; its ``gearbox`` decides whether it has one mass or two.
    command
        Commanded angle, rad, shape (n,), one value per control period.
    friction
        Coulomb friction T_c, N·m, shape (n,).
    load_slope, load_offset
        Hinge moment = slope·angle + offset, N·m/rad and N·m, shape (n,).
    degradation
        Degradation; healthy if omitted.
    control_period_s, step_s
        Control period, and integration step, of which a period contains an integer number.

    Raises
    ------
    ValueError
        If a rigid gear has backlash, or arrays differ in length.

    Examples
    --------
    >>> zeros = np.zeros(500)
    >>> motion = simulate(EmaParameters.from_data_sheet(), zeros + 1.0, zeros + 0.225, zeros, zeros)
    >>> float(np.degrees(motion.speed[300]).round(1))
    100.0
    """
    n = len(command)
    degradation = degradation or Degradation.none(n)
    if parameters.gearbox is None and degradation.backlash.any():
        raise ValueError("a rigid gear has no backlash; give the actuator a Gearbox (two masses)")
    worn = [getattr(degradation, field.name) for field in fields(degradation)]
    inputs = [np.ascontiguousarray(a, dtype=np.float64) for a in (command, friction, load_slope, load_offset)]
    if any(array.shape != (n,) for array in (*inputs, *worn)):
        raise ValueError(f"every input must have the command's {n} values")
    kernel = integrate_two_masses if parameters.gearbox else integrate_one_mass
    steps = max(1, round(control_period_s / step_s))
    state = kernel(control_period_s / steps, steps, parameters.constants(), Course(*inputs, *worn))
    time_s = (np.arange(n, dtype=np.float64) + 1.0) * control_period_s
    return Motion(time_s, command, *state, friction, degradation)
