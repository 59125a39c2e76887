"""What keeps an ArduPlane VTOL in the air: its lift motors, which of them tilt, and how far.

Quadplanes report the type of a fixed wing, and helicopters run the firmware of multirotors. Their parameters
say what they are: Q_ENABLE, Q_TILT_MASK for the motors that tilt, Q_TAILSIT_MOTMX for those that pull a
tailsitter forward; FRAME_CLASS of a helicopter, whose "motors" are the servos of its rotors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.vehicle.facts import ARDUPILOT
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.parameters import MOTORS, functions_of, lacking

VTOL_PARAMETERS: Final = ("Q_ENABLE", "Q_FRAME_", "Q_M_", "Q_T", "FRAME_CLASS")
"""Beginnings of the names of parameters that say what lifts."""

_TILTS: Final = (41, 45, 46, 47, 75, 76)  # SERVOn_FUNCTION of servos that tilt motors
_FIXED_WING: Final = "fixed wing"
_TRICOPTER: Final = 7  # Q_FRAME_CLASS, whose motor 7 is the servo that tilts the tail
_TAIL_SERVO: Final = 6
_TAILSITTER: Final = 10  # Q_FRAME_CLASS
_FRAME_CLASSES: Final[dict[float, str]] = {
    1: "quadrotor",
    2: "hexarotor",
    3: "octorotor",
    4: "octorotor",
    5: "hexarotor",
    7: "tricopter",
}
"""Kinds by ArduCopter's FRAME_CLASS, as its heartbeats name them."""
_HELICOPTERS: Final = (6, 11, 13)  # FRAME_CLASS

_MOST_IDLE: Final = 0.5  # share of the range: a damaged parameter cannot hide the motors permanently

HOVERING_MODES: Final = (17, 18, 19, 20, 21, 22, 23, 25)
"""ArduPlane's Q modes."""
_HELD_MODES: Final = (17, 18, 19, 20)
"""Of these, those that hold a hover: QRTL flies forward first, QAUTOTUNE and QACRO are no steady flight."""
_MC: Final = 3  # MAV_VTOL_STATE
LEAST_SPEED: Final = 8.0
"""Airspeed of forward flight, m/s, from which the surfaces answer for what the motors do. Lower lets wind on
the ground in, higher loses slow aircraft."""

_CARRIES: Final = 0.05
"""Share of its range above its idle speed from which a lift motor carries. A tiltrotor that cruises keeps its
fixed motors within 0.05 for 93 % of the time; in a hover every motor is above 0.2. Less loses cruise, more
judges transitions, in which the lift motors answer for the surfaces."""

_FORWARD: Final = 0.8
"""Share of their servos' travel from which tilted motors pull: 72° or more, where under a third of the thrust
lifts. A transition waits at Q_TILT_MAX, which is 45° by default: half of the travel."""


class _LiftMotor(NamedTuple):
    """A lift motor: its output, and the pulse above which it carries."""

    servo: int
    carries_us: float


class _Tilt(NamedTuple):
    """A servo that tilts motors: its output, and its pulses with the motors up and forward."""

    servo: int
    up_us: float
    forward_us: float


@dataclass(frozen=True, slots=True)
class Lift:
    """The outputs that carry a vehicle when it hovers.

    Attributes
    ----------
    fixed, tilting
        Motors that only lift, and motors that pull forward once they are tilted.
    tilts
        Servos that tilt them.
    """

    fixed: tuple[_LiftMotor, ...] = ()
    tilting: tuple[_LiftMotor, ...] = ()
    tilts: tuple[_Tilt, ...] = ()

    @property
    def servos(self) -> frozenset[int]:
        """The motors' outputs."""
        return frozenset(motor.servo for motor in (*self.fixed, *self.tilting))

    def works(self, pulses: Array) -> Flags:
        """Return where motors carry the vehicle, shape (n,).

        Parameters
        ----------
        pulses
            Pulses of the outputs, µs, shape (n, outputs), NaN where unknown.
        """
        return _carries(self.fixed, pulses) | (_carries(self.tilting, pulses) & ~self._tilted(pulses))

    def _tilted(self, pulses: Array) -> Flags:
        """Return where the motors point forward.

        Where no tilt is known, the motors that do not tilt decide, if there are any.
        """
        if not self.tilts:
            return np.full(len(pulses), bool(self.fixed))
        sent = pulses[:, [tilt.servo - 1 for tilt in self.tilts]]
        up, forward = np.array([tilt[1:] for tilt in self.tilts]).T
        share = (sent - up) / (forward - up)
        tilted = (np.isnan(share) | (share >= _FORWARD)).all(axis=1)
        return np.where(np.isnan(share).all(axis=1), bool(self.fixed), tilted)


def hovers(signals: Mapping[str, Array]) -> Flags:
    """Return where a quadplane hovers, by its mode or its VTOL state and its airspeed, shape (n,).

    Parameters
    ----------
    signals
        On a common grid, shape (n, columns).
    """
    autopilot, mode = signals["state"][:, 1], signals["state"][:, 3]
    vtol = signals["vtol"][:, 0]
    held = (autopilot == ARDUPILOT) & np.isin(mode, _HELD_MODES) & ~(vtol > 0)
    hovering: Flags = (held | (vtol == _MC)) & ~(signals["airspeed"][:, 0] > LEAST_SPEED)
    return hovering


NO_LIFT: Final = Lift()
"""What carries a vehicle that does not hover."""


def _carries(motors: tuple[_LiftMotor, ...], pulses: Array) -> Flags:
    columns = [motor.servo - 1 for motor in motors]
    return np.asarray((pulses[:, columns] > [motor.carries_us for motor in motors]).any(axis=1))


def lift_of(values: Mapping[str, float]) -> Lift:
    """Return what lifts an ArduPlane or another ArduPilot vehicle with these parameters.

    Examples
    --------
    >>> quad = {"SERVO5_FUNCTION": 33.0, "SERVO6_FUNCTION": 34.0, "Q_ENABLE": 1.0}
    >>> sorted(lift_of(quad).servos), sorted(lift_of(quad | {"Q_ENABLE": 0.0}).servos)
    ([5, 6], [])
    """
    functions = functions_of(values)
    numbers = {n: MOTORS[function] for n, function in functions.items() if function in MOTORS}
    if values.get("Q_ENABLE") == 0.0:
        return NO_LIFT
    low, high = (
        next((values[name] for name in names if values.get(name, 0.0) > 0.0), usual)
        for names, usual in (
            (("Q_M_PWM_MIN", "Q_THR_MIN_PWM"), 1000.0),
            (("Q_M_PWM_MAX", "Q_THR_MAX_PWM"), 2000.0),
        )
    )
    idle = values.get("Q_M_SPIN_MIN", 0.0)
    carries_us = low + (min(max(idle, 0.0), _MOST_IDLE) + _CARRIES) * max(high - low, 0.0)
    if values.get("Q_FRAME_CLASS") == _TRICOPTER:
        numbers = {n: number for n, number in numbers.items() if number != _TAIL_SERVO}
    pulls = _mask(values, "Q_TAILSIT_MOTMX") if _is_tailsitter(values) else 0
    tilted = _mask(values, "Q_TILT_MASK") if _tilts(values) else 0
    motors = {n: _LiftMotor(n, carries_us) for n, number in numbers.items() if not pulls >> number & 1}
    tilts = (
        _tilt(n, values)
        for n, function in functions.items()
        if function in _TILTS and not lacking(values, "SERVO", n, ("MIN", "MAX", "REVERSED"))
    )
    return Lift(
        tuple(motor for n, motor in motors.items() if not tilted >> numbers[n] & 1),
        tuple(motor for n, motor in motors.items() if tilted >> numbers[n] & 1),
        tuple(tilt for tilt in tilts if tilt.up_us != tilt.forward_us) if tilted else (),
    )


def refined_identity(identity: Identity, values: Mapping[str, float]) -> Identity:
    """Return the identity of a vehicle with the kind that its parameters give.

    Examples
    --------
    >>> refined_identity(Identity(1, "fixed wing"), {"Q_ENABLE": 1.0, "Q_TILT_MASK": 5.0}).kind
    'tiltrotor'
    >>> refined_identity(Identity(1, "multirotor", multirotor=True), {"FRAME_CLASS": 2.0}).kind
    'hexarotor'
    """
    # An on-board log has the firmware's name alone, which serves all numbers of rotors.
    if identity.kind == "multirotor" and (kind := _FRAME_CLASSES.get(values.get("FRAME_CLASS", 0.0))):
        return replace(identity, kind=kind)
    if values.get("FRAME_CLASS") in _HELICOPTERS and (identity.multirotor or identity.kind is None):
        return replace(identity, kind="helicopter", multirotor=False)
    if identity.kind != _FIXED_WING or not values.get("Q_ENABLE", 0.0) > 0.0:
        return identity
    kind = "tailsitter" if _is_tailsitter(values) else "tiltrotor" if _tilts(values) else "quadplane"
    return replace(identity, kind=kind)


def turns_its_motors(values: Mapping[str, float]) -> bool:
    """Return whether some of an ArduPlane's lift motors pull forward, too: a tiltrotor, a tailsitter."""
    return _tilts(values) or _is_tailsitter(values)


def _mask(values: Mapping[str, float], name: str) -> int:
    return int(min(max(values.get(name, 0.0), 0.0), 2.0**31))


def _is_tailsitter(values: Mapping[str, float]) -> bool:
    known = values.get("Q_TAILSIT_ENABLE")
    return values.get("Q_FRAME_CLASS") == _TAILSITTER if known is None else known > 0.0


def _tilts(values: Mapping[str, float]) -> bool:
    return values.get("Q_TILT_ENABLE") != 0.0 and _mask(values, "Q_TILT_MASK") > 0


def _tilt(servo: int, values: Mapping[str, float]) -> _Tilt:
    low, high = values.get(f"SERVO{servo}_MIN", 1100.0), values.get(f"SERVO{servo}_MAX", 1900.0)
    return _Tilt(servo, high, low) if values.get(f"SERVO{servo}_REVERSED") == 1.0 else _Tilt(servo, low, high)
