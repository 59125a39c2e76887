"""Energy balance: a check of the integration that shares none of its code."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim.ema import EmaParameters
from mavhums_sim.motion import simulate

_STEP_S = 1e-5
_COULOMB = 0.225


@dataclass(frozen=True, slots=True)
class EnergyBalance:
    """Energies of one run, J.

    Attributes
    ----------
    supplied
        ∫U·I dt at the motor's terminals.
    copper, friction, gear
        Dissipated in the winding, by friction and drag, and in the teeth.
    load
        Work against the hinge moment.
    stored
        Stored at the end in the rotating masses, the winding's field and the elastic teeth.
    """

    supplied: float
    copper: float
    friction: float
    gear: float
    load: float
    stored: float

    @property
    def residual(self) -> float:
        """Supplied energy that is not accounted for."""
        return self.supplied - self.copper - self.friction - self.gear - self.load - self.stored


def energy_balance(parameters: EmaParameters, seconds: float = 2.0) -> EnergyBalance:
    """Move an actuator against a spring load, and compute its energies.

    They are integrated by the trapezoidal rule over steps of 10 µs.
    """
    n = round(seconds / _STEP_S)
    command = np.radians(20.0) * np.sin(2 * pi * 0.7 * np.arange(n) * _STEP_S)
    slope, offset, friction = np.full(n, 5.0), np.full(n, 0.5), np.full(n, _COULOMB)
    m = simulate(parameters, command, friction, slope, offset, control_period_s=_STEP_S, step_s=_STEP_S)
    c, gear = parameters.constants(), parameters.gearbox
    rotor_share = gear.rotor_friction if gear else 1.0
    rubbing = rotor_share * np.abs(m.rotor_speed) + (1.0 - rotor_share) * np.abs(m.speed)
    kinetic = 0.5 * c.inertia * m.rotor_speed[-1] ** 2
    teeth_heat = elastic = 0.0
    if gear:
        kinetic += 0.5 * c.output_inertia * m.speed[-1] ** 2
        stretch = _stretch(m.rotor_angle - m.angle, c.backlash)
        slip = m.rotor_speed - m.speed
        spring = c.stiffness * stretch
        torque = np.where(stretch > 0, np.maximum(spring + c.damping * slip, 0.0), 0.0)
        torque += np.where(stretch < 0, np.minimum(spring + c.damping * slip, 0.0), 0.0)
        teeth_heat = _integral((torque - spring) * slip)
        elastic = 0.5 * c.stiffness * float(stretch[-1]) ** 2
    field = 0.5 * c.inductance * m.current[-1] ** 2
    return EnergyBalance(
        supplied=_integral(m.voltage * m.current),
        copper=_integral(c.resistance * m.current**2),
        friction=_integral(_COULOMB * rubbing + c.viscous * m.rotor_speed**2),
        gear=teeth_heat,
        load=_integral(m.load * m.speed),
        stored=float(kinetic + field) + elastic,
    )


def _stretch(twist: Array, play: float) -> Array:
    """Return the elastic deflection of the teeth beyond the play."""
    pressed: Array = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * play, 0.0)
    return pressed


def _integral(power: Array) -> float:
    return float(np.trapezoid(power, dx=_STEP_S))
