"""The paper's electromechanical actuator: one rotating mass with Coulomb friction and stiction.

Torque balance at the output shaft (paper, section 4):

    N k_t I = N² J dω/dt + T_ext + T_D,        L dI/dt = U - R I - N k_t ω

The elastic torque T_E is absent, for the gear is rigid. T_D is Coulomb friction T_c against the
motion, and holds the shaft up to T_s while it rests. Data sheet to constants: an ideal gear, so
that friction is the only loss, and a controller whose speed command is limited to reach the data
sheet's no-load speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._integrate import integrate

__all__ = ["CONTROL_PERIOD_S", "DataSheet", "EmaParameters", "Motion", "simulate"]

CONTROL_PERIOD_S = 1e-3
_STEPS_PER_PERIOD = 10

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DataSheet:
    """The main characteristics of an EMA; the defaults are the paper's Table 1."""

    nominal_torque_nm: float = 3.5
    stall_torque_nm: float = 5.0
    no_load_speed_deg_s: float = 100.0
    stroke_deg: float = 60.0
    supply_voltage_v: float = 27.0
    nominal_current_a: float = 0.85
    mass_kg: float = 0.36


@dataclass(frozen=True, slots=True)
class EmaParameters:
    """Constants of the single-mass model, referred to the output shaft unless the name says rotor.

    Attributes
    ----------
    torque_per_ampere
        N·k_t, N·m/A; the back-EMF constant in V·s/rad is the same number.
    resistance, inductance
        Of the stator winding, Ω and H.
    inertia
        N²·J, kg·m².
    slew_limit
        Largest commanded speed, rad/s.
    position_gain, speed_gain, integral_gain
        Controller: 1/s, V·s/rad, V/rad.
    stiction_ratio
        T_s / T_c.
    """

    gear_ratio: float
    torque_per_ampere: float
    resistance: float
    inductance: float
    inertia: float
    supply_voltage: float
    current_limit: float
    slew_limit: float
    stroke: float
    position_gain: float = 20.0
    speed_gain: float = 40.0
    integral_gain: float = 0.0
    stiction_ratio: float = 1.2

    @classmethod
    def from_data_sheet(
        cls,
        sheet: DataSheet | None = None,
        *,
        healthy_friction_nm: float = 0.225,
        gear_ratio: float = 300.0,
        inductance: float = 2e-3,
        rotor_inertia: float = 2.4e-7,
        integral_gain: float = 0.0,
    ) -> EmaParameters:
        """Derive the constants from a data sheet.

        The nominal torque and the friction together take the nominal current, which fixes N·k_t;
        the supply drives the stall current through the winding, which fixes R.
        """
        sheet = sheet or DataSheet()
        torque_per_ampere = (sheet.nominal_torque_nm + healthy_friction_nm) / sheet.nominal_current_a
        stall_current = (sheet.stall_torque_nm + healthy_friction_nm) / torque_per_ampere
        resistance = sheet.supply_voltage_v / stall_current
        speed_gain = 40.0
        droop = 0.0 if integral_gain else resistance * healthy_friction_nm / torque_per_ampere / speed_gain
        return cls(
            gear_ratio=gear_ratio,
            torque_per_ampere=torque_per_ampere,
            resistance=resistance,
            inductance=inductance,
            inertia=rotor_inertia * gear_ratio**2,
            supply_voltage=sheet.supply_voltage_v,
            current_limit=stall_current,
            slew_limit=radians(sheet.no_load_speed_deg_s) + droop,
            stroke=radians(sheet.stroke_deg),
            speed_gain=speed_gain,
            integral_gain=integral_gain,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What the actuator did, one row per control period (1 ms); every array has shape (n,).

    Attributes
    ----------
    command, angle
        Output shaft, rad.
    speed
        Output shaft, rad/s; exactly zero while friction holds the shaft.
    current, voltage
        At the motor's terminals, A and V.
    load
        Hinge moment T_ext, N·m, positive against motion towards positive angles.
    friction
        Coulomb friction T_c, N·m.
    """

    time_s: Array
    command: Array
    angle: Array
    speed: Array
    current: Array
    voltage: Array
    load: Array
    friction: Array

    @property
    def moving_fraction(self) -> float:
        """Share of the time in which the shaft turned."""
        return float(np.mean(self.speed != 0.0))


def simulate(
    parameters: EmaParameters, command: Array, friction: Array, load_slope: Array, load_offset: Array
) -> Motion:
    """Drive the actuator from rest through a cyclogram.

    Parameters
    ----------
    parameters
        Constants of the actuator.
    command
        Commanded angle, rad, shape (n,), one value per control period of 1 ms.
    friction
        Coulomb friction T_c, N·m, shape (n,).
    load_slope, load_offset
        Hinge moment = slope·angle + offset, N·m/rad and N·m, shape (n,).
    """
    state = integrate(
        CONTROL_PERIOD_S / _STEPS_PER_PERIOD,
        _STEPS_PER_PERIOD,
        parameters.torque_per_ampere,
        parameters.resistance,
        parameters.inductance,
        parameters.inertia,
        parameters.supply_voltage,
        parameters.current_limit,
        parameters.slew_limit,
        parameters.stroke,
        parameters.position_gain,
        parameters.speed_gain,
        parameters.integral_gain,
        parameters.stiction_ratio,
        np.ascontiguousarray(command, dtype=np.float64),
        np.ascontiguousarray(friction, dtype=np.float64),
        np.ascontiguousarray(load_slope, dtype=np.float64),
        np.ascontiguousarray(load_offset, dtype=np.float64),
    )
    time_s = (np.arange(len(command), dtype=np.float64) + 1.0) * CONTROL_PERIOD_S
    return Motion(time_s, command, *state, friction)
