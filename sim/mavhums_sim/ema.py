"""Parameters of an actuator: its data sheet, and the constants of its models.

Torque balance (paper, section 4), at the output shaft:

    N·k_t·I = N²·J·dω/dt + T_ext + T_E + T_D,        L·dI/dt = U − R·I − N·k_t·ω

With a rigid gear there is one mass and no T_E. With a :class:`Gearbox`, rotor and output shaft are two
masses, and T_E is the torque of the teeth. T_D is viscous drag plus dry friction: T_c against the motion,
and up to T_s at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, radians
from typing import Literal

from mavhums_sim._integrate import Constants

FrictionMethod = Literal["impulse", "karnopp"]

_KARNOPP_BAND = 0.005


@dataclass(frozen=True, slots=True)
class DataSheet:
    """The main characteristics of an EMA; the defaults are the paper's Table 1.

    Raises
    ------
    ValueError
        If a number is not positive, or the stall torque is not above the nominal torque.
    """

    nominal_torque_nm: float = 3.5
    stall_torque_nm: float = 5.0
    no_load_speed_deg_s: float = 100.0
    stroke_deg: float = 60.0
    supply_voltage_v: float = 27.0
    nominal_current_a: float = 0.85
    mass_kg: float = 0.36

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"data sheet: {name} must be a positive number")
        if self.stall_torque_nm <= self.nominal_torque_nm:
            raise ValueError("data sheet: the stall torque must be above the nominal torque")


@dataclass(frozen=True, slots=True)
class Gearbox:
    """An elastic gear with play between rotor and output shaft, referred to the output shaft.

    Attributes
    ----------
    stiffness, damping
        Stiffness and damping of the teeth in contact, N·m/rad and N·m·s/rad.
    backlash
        Total play, rad.
    rotor_share
        Fraction of the actuator's inertia on the rotor; the rest, and ``surface_inertia`` (kg·m²), are
        on the output shaft.
    rotor_friction
        Fraction of the dry friction that acts on the rotor.
    """

    stiffness: float = 400.0
    damping: float = 1.5
    backlash: float = radians(0.08)
    rotor_share: float = 5.0 / 6.0
    surface_inertia: float = 0.004
    rotor_friction: float = 0.6


@dataclass(frozen=True, slots=True)
class EmaParameters:
    """Constants of an actuator, referred to the output shaft.

    Attributes
    ----------
    gear_ratio
        N, rotor revolutions per revolution of the output shaft.
    torque_per_ampere
        N·k_t, N·m/A; the back-EMF constant in V·s/rad is the same number.
    resistance, inductance
        Resistance and inductance of the stator winding, Ω and H.
    inertia
        N²·J of rotor and gear, kg·m².
    supply_voltage, current_limit
        Supply voltage, V, and current limit, A.
    slew_limit, stroke
        Maximum commanded speed, rad/s, and maximum angle to either side, rad.
    position_gain, speed_gain, integral_gain
        Controller gains: 1/s, V·s/rad, V/rad.
    stiction_ratio
        T_s / T_c.
    viscous
        Viscous drag on the rotor, N·m·s/rad.
    load_friction
        μ of the friction T_c + μ·|load|; the paper's does not depend on the load.
    gearbox
        Elastic gear with play: two masses. None is a rigid gear: one mass.
    friction_method
        ``impulse`` (Moreau; stable at any step) or ``karnopp`` (rest is a band of speed).
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
    viscous: float = 0.0
    load_friction: float = 0.0
    gearbox: Gearbox | None = None
    friction_method: FrictionMethod = "impulse"

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
        gearbox: Gearbox | None = None,
        friction_method: FrictionMethod = "impulse",
    ) -> EmaParameters:
        """Derive the constants from a data sheet, with an ideal gear and a slew limit.

        N·k_t follows from the nominal current, which balances nominal torque plus friction; R follows
        from the stall current at the supply voltage; the slew limit follows from the no-load speed.
        Identified constants replace the other defaults.

        Parameters
        ----------
        sheet
            Table 1 of the paper if omitted.
        healthy_friction_nm
            T_c of the actuator that the data sheet describes.
        rotor_inertia
            J of rotor and gear at the rotor, kg·m².

        Examples
        --------
        >>> paper = EmaParameters.from_data_sheet()
        >>> round(paper.torque_per_ampere, 5), round(paper.resistance, 4)
        (4.38235, 22.6457)
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
            gearbox=gearbox,
            friction_method=friction_method,
        )

    def two_masses(self, gearbox: Gearbox | None = None) -> EmaParameters:
        """Return the same actuator with an elastic gear, :class:`Gearbox`'s defaults if omitted."""
        return replace(self, gearbox=gearbox or Gearbox())

    def constants(self) -> Constants:
        """Return the constants for the kernels."""
        gear = self.gearbox or Gearbox(rotor_share=1.0)
        return Constants(
            torque_per_ampere=self.torque_per_ampere,
            resistance=self.resistance,
            inductance=self.inductance,
            inertia=self.inertia * gear.rotor_share,
            viscous=self.viscous,
            supply_voltage=self.supply_voltage,
            current_limit=self.current_limit,
            slew_limit=self.slew_limit,
            stroke=self.stroke,
            position_gain=self.position_gain,
            speed_gain=self.speed_gain,
            integral_gain=self.integral_gain,
            stiction_ratio=self.stiction_ratio,
            karnopp_band=_KARNOPP_BAND if self.friction_method == "karnopp" else 0.0,
            output_inertia=self.inertia * (1.0 - gear.rotor_share) + gear.surface_inertia,
            stiffness=gear.stiffness,
            damping=gear.damping,
            backlash=gear.backlash,
            rotor_friction=gear.rotor_friction,
            load_friction=self.load_friction,
        )
