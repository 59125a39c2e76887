"""Own-scale equations: friction in units that need no constant of the servo.

Current, from V5 and V7 or V10:

    V5 = I_c·sgn(w) + b·w + J·dw/dt + h·q·d + o        I_c = T_c/(N·k_t), A

Voltage, from V4 and V7 or V10, where no current is evidence; b holds the back-EMF, and a rise of R counts:

    V4 = U_c·sgn(w) + b·w + J·dw/dt + h·q·d + o        U_c = R·T_c/(N·k_t), V

In each of them friction grows with the load, as in :mod:`.terms`:
I_c is that at the median load of the reference flights.

Position error in motion, for servos that measure only command and angle:

    V1 - V3 = e·sgn(w) + b·w + J·dw/dt + h·q·d + o

A proportional controller has a position error that grows with friction; play and a warm or worn winding
have the same effect, and integral action hides all of them. A change is therefore reported as a change of
tracking, without a cause.
"""

from __future__ import annotations

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array
from mavhums.core.quantities import column
from mavhums.core.statistics import RAD_S_PER_REV_MIN
from mavhums.health.estimation.equations.interface import OwnEquation, ServoSpeed
from mavhums.health.estimation.motion import central_slope
from mavhums.health.estimation.slots import SENSED, Slots
from mavhums.health.estimation.thresholds import MOVING_ANGLE_DEG_S, MOVING_ROTOR_REV_MIN, REFERENCE_FLIGHTS

_V1, _V3, _V4, _V5, _V7, _V10 = (column(f"V{k}") for k in (1, 3, 4, 5, 7, 10))


def _rotor_speed(actuator: Actuator, slots: Slots) -> ServoSpeed:
    """Return the rotor's speed, or the output shaft's where only that is measured."""
    rotor, output = slots.values[:, _V7], slots.values[:, _V10]
    if np.isfinite(output).any() and not np.isfinite(rotor).any():
        return ServoSpeed(output * RAD_S_PER_REV_MIN, float(np.radians(actuator.moving_speed_deg_s)))
    moving = MOVING_ROTOR_REV_MIN if actuator.ema is None else actuator.moving_speed_rev_min
    return ServoSpeed(rotor * RAD_S_PER_REV_MIN, moving * RAD_S_PER_REV_MIN)


def _current(actuator: Actuator, slots: Slots) -> Array:
    """Return the motor's current; a current at the bus is another quantity."""
    current: Array = slots.values[:, _V5]
    return np.full(current.shape, np.nan) if actuator.esc_side == "bus" else current


def _position_error(actuator: Actuator, slots: Slots) -> Array:
    """Return command less angle; an angle that is derived from the rotor's would hide the gear's play."""
    measured = slots.values[:, SENSED] > 0
    error: Array = np.where(measured, slots.values[:, _V1] - slots.values[:, _V3], np.nan)
    return error


def _angle_speed(actuator: Actuator, slots: Slots) -> ServoSpeed:
    speed, _ = central_slope(slots.time_s, np.radians(slots.values[:, _V3]))
    return ServoSpeed(speed, np.radians(MOVING_ANGLE_DEG_S))


def _voltage(actuator: Actuator, slots: Slots) -> Array:
    """Return the motor's voltage where no current is evidence."""
    volts, current = slots.values[:, _V4], slots.values[:, _V5]
    alone = np.isnan(current) & (actuator.esc_side == "motor")
    return np.where(alone, volts, np.nan)


CURRENT = OwnEquation(
    name="own_current",
    fault="friction_current",
    quantity="friction current",
    unit="A",
    inspect="gearbox, bearings and hinge line",
    cause="friction",
    left=_current,
    speed=_rotor_speed,
)

VOLTAGE = OwnEquation(
    name="own_friction_voltage",
    fault="friction_voltage",
    quantity="friction voltage",
    unit="V",
    inspect="gearbox, bearings and hinge line",
    cause="friction, or a warmer or worn winding: the voltage does not show which",
    left=_voltage,
    speed=_rotor_speed,
)

TRACKING = OwnEquation(
    name="own_tracking",
    fault="tracking",
    quantity="tracking error in motion",
    unit="°",
    inspect="gearbox, linkage and motor, and whether the servo's settings were changed",
    cause="friction, play or winding: the log does not show which",
    min_flights=REFERENCE_FLIGHTS,
    left=_position_error,
    speed=_angle_speed,
    by_activity=True,
    blurs=True,  # a servo without power or torque falls behind by whole degrees, now more and now less
)

TWO_WAYS = OwnEquation(
    name="own_two_ways",
    fault="friction_both_ways",
    quantity="current both ways over that at rest",
    unit="A",
    inspect="gearbox, bearings, screw and their lubrication",
    cause="friction, play or motor: the magnitude of a current does not show which",
    left=_current,
    speed=_angle_speed,
)

ROUGHNESS = OwnEquation(
    name="own_roughness",
    fault="rough_tracking",
    quantity="roughness of steady motion",
    unit="°",
    inspect="gearbox, bearings, their lubrication, and the position sensor",
    cause="the motion is rough; the log does not show why",
    left=_position_error,
    speed=_angle_speed,
)

RIPPLE = OwnEquation(
    name="own_ripple",
    fault="current_ripple",
    quantity="ripple of the current in steady motion",
    unit="A",
    inspect="gearbox, bearings and motor",
    cause="the current is rough; the log does not show why",
    left=_current,
    speed=_angle_speed,
)
