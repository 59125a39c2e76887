"""The autopilot: guidance, speed and height, attitude, as compiled functions.

Guidance after R. W. Beard, T. W. McLain, "Small Unmanned Aircraft", 2012, chapter 10 (straight line and
orbit); speed and height by the energy's rate; attitude by a rate loop with feed-forward that is scaled
with airspeed, the structure that ArduPlane and PX4 have in common. Angles in rad, SI units; a positive
elevator demand raises the nose, a positive aileron or rudder demand turns right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan, atan2, cos, hypot, pi, sin, tan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim._compiled import kernel

CLIMB, TRACK, LOITER, HEADING, STICKS = range(5)
GRAVITY = 9.80665
PERIOD_S = 0.02
_LOW_M = 70.0  # below which the pilot climbs


@dataclass(frozen=True, slots=True)
class Autopilot:
    """Gains and limits.

    Attributes
    ----------
    roll_time, pitch_time
        Time constants of the attitude loops, s.
    roll_feed, roll_gain, roll_integral
        Aileron per rate demanded, per error of rate (s) and per its integral (1).
    pitch_feed, pitch_gain, pitch_integral
        The same for the elevator.
    rudder_mix, yaw_damper
        Rudder per aileron, and per yaw rate beyond that of the turn, s.
    bank_limit, pitch_limit, roll_rate_limit, travel
        rad, rad, rad/s, rad.
    course_gain
        Course rate per error of course, 1/s.
    speed
        Reference airspeed of the gains, m/s.
    """

    roll_time: float = 0.5
    pitch_time: float = 0.5
    roll_feed: float = 0.16
    roll_gain: float = 0.05
    roll_integral: float = 0.15
    pitch_feed: float = 0.30
    pitch_gain: float = 0.10
    pitch_integral: float = 0.30
    rudder_mix: float = 0.3
    yaw_damper: float = 0.15
    bank_limit: float = 0.785
    pitch_limit: float = 0.35
    roll_rate_limit: float = 1.3
    course_gain: float = 0.5
    travel: float = 0.4363
    speed: float = 25.0

    @classmethod
    def tuned(cls, seed: int, flavour: str) -> Autopilot:
        """Return the gains that the operator of airframe ``seed`` chose.

        Within ±25 % of the defaults; time constants of the attitude 0.75…1.8 of them. A rudder that follows
        the ailerons by more than half has a yaw damper, for the Dutch roll of some airframes grows without.
        """
        rng = np.random.default_rng([seed, 22])
        base = cls() if flavour == "ardupilot" else cls(roll_time=0.4, pitch_time=0.4, rudder_mix=0.0)
        scaled = ("roll_gain", "roll_integral", "pitch_gain", "pitch_integral")
        drawn = {name: getattr(base, name) * rng.uniform(0.75, 1.25) for name in scaled}
        drawn |= {name: getattr(base, name) * rng.uniform(0.75, 1.8) for name in ("roll_time", "pitch_time")}
        mixed = rng.uniform(0.0, 0.6) if flavour == "ardupilot" else 0.0
        damper = float(rng.choice([0.0, 0.15, 0.3]))
        return replace(
            base,
            **drawn,
            rudder_mix=mixed,
            yaw_damper=max(damper, 0.15) if mixed > 0.5 else damper,
            bank_limit=rng.uniform(0.6, 0.87),
        )

    def record(self) -> NDArray[np.void]:
        """Return the gains as a record of one row, which compiled code reads by name."""
        kind = np.dtype([(name, "f8") for name in self.__slots__])
        return np.array([tuple(getattr(self, name) for name in self.__slots__)], dtype=kind)


@kernel
def wrap(angle: float) -> float:
    """Return the angle wrapped to ±π."""
    return (angle + pi) % (2.0 * pi) - pi


@kernel
def course_of(leg: Any, north: float, east: float) -> tuple[float, float, float]:
    """Return the course to fly for a leg, rad, and the bank of its turn as tan φ·g, m/s²."""
    if leg.kind == LOITER:
        side = 1.0 if leg.radius > 0.0 else -1.0
        radius = abs(leg.radius)
        distance = hypot(north - leg.north, east - leg.east)
        bearing = atan2(east - leg.east, north - leg.north)
        return bearing + side * (0.5 * pi + atan(2.0 * (distance - radius) / radius)), side, radius
    if leg.kind == TRACK:
        along = atan2(leg.east - leg.east0, leg.north - leg.north0)
        cross = -sin(along) * (north - leg.north0) + cos(along) * (east - leg.east0)
        return along - 1.2 * 2.0 / pi * atan(0.012 * cross), 0.0, 1.0
    return leg.heading, 0.0, 1.0


@kernel
def guide(leg: Any, a: Any, m: Any, x: tuple[float, ...], stick: Array) -> None:
    """Set the demands of roll, pitch and throttle in the memory ``m`` from the estimated state ``x``.

    Parameters
    ----------
    leg, a, m
        Rows of the mission, of :meth:`Autopilot.record` and of the flight's memory.
    x
        North, east, height, airspeed, ground speed, course, climb rate, roll.
    stick
        The pilot's roll and pitch demands for a leg of kind ``STICKS``.
    """
    north, east, height, airspeed, ground, course, climb, roll = x
    if leg.kind == STICKS:
        m.nav_roll, slope = stick[0] * a.bank_limit, stick[1] * 0.12
        if height < _LOW_M:
            slope = max(slope, 0.06)
    elif leg.kind == CLIMB:
        m.nav_roll = 0.0
        slope = 0.16
    else:
        wanted, side, radius = course_of(leg, north, east)
        m.course_error = wrap(wanted - course)
        rate = a.course_gain * m.course_error + side * ground / radius
        bank = atan(rate * max(ground, 8.0) / GRAVITY)
        m.nav_roll = min(max(bank, -a.bank_limit), a.bank_limit)
        rise = 0.25 * (leg.height - height)
        slope = min(max(rise, -2.5), 2.5) / max(airspeed, 8.0)
    m.height_error, m.speed_error = leg.height - height, leg.speed - airspeed
    slow = leg.speed - 3.0 - airspeed
    if slow > 0.0:
        slope -= 0.05 * slow
    path = climb / max(airspeed, 8.0)
    m.pitch_integral += 0.25 * (slope - path) * PERIOD_S
    m.pitch_integral = min(max(m.pitch_integral, -0.25), 0.25)
    pitch = 0.05 + slope + m.pitch_integral + 0.04 * (1.0 / max(cos(roll), 0.5) - 1.0)
    low = -0.30 if slow <= 0.0 else -0.22
    pitch = min(max(pitch, low), a.pitch_limit)
    m.nav_pitch += min(max(pitch - m.nav_pitch, -0.5 * PERIOD_S), 0.5 * PERIOD_S)
    error = m.speed_error + 15.0 * (slope - path)
    free = 0.55 + 0.06 * m.speed_error + 1.2 * slope + m.throttle_integral
    free += 0.25 * (1.0 / max(cos(roll), 0.5) - 1.0)
    if 0.0 < free < 1.0 or error * free < 0.0:
        m.throttle_integral = min(max(m.throttle_integral + 0.01 * error * PERIOD_S, -0.5), 0.5)
    target = 1.0 if leg.kind == CLIMB else min(max(free, 0.0), 1.0)
    m.throttle += min(max(target - m.throttle, -PERIOD_S), PERIOD_S)


@kernel
def attitude(a: Any, m: Any, x: tuple[float, ...]) -> None:
    """Set the demands of aileron, elevator and rudder in ``m``.

    Parameters
    ----------
    x
        Roll, pitch, p, q, r, airspeed as measured.
    """
    roll, pitch, p, q, r, airspeed = x
    scale = min(max(a.speed / max(airspeed, 5.0), 0.6), 1.8)
    roll_rate = (m.nav_roll - roll) / a.roll_time
    roll_rate = min(max(roll_rate, -a.roll_rate_limit), a.roll_rate_limit)
    error = roll_rate - p
    aileron = scale * a.roll_feed * roll_rate + scale * scale * (a.roll_gain * error + m.roll_sum)
    if abs(aileron) < a.travel or error * aileron < 0.0:
        m.roll_sum = min(max(m.roll_sum + a.roll_integral * error * PERIOD_S, -0.2), 0.2)
    bank = min(max(roll, -1.2), 1.2)
    turn = GRAVITY / max(airspeed, 8.0) * tan(bank)
    pitch_rate = min(max((m.nav_pitch - pitch) / a.pitch_time, -0.6), 0.6) + turn * sin(bank) * cos(pitch)
    error = pitch_rate - q
    elevator = scale * a.pitch_feed * pitch_rate + scale * scale * (a.pitch_gain * error + m.pitch_sum)
    if abs(elevator) < a.travel or error * elevator < 0.0:
        m.pitch_sum = min(max(m.pitch_sum + a.pitch_integral * error * PERIOD_S, -0.25), 0.25)
    yaw_rate = turn * cos(bank) * cos(pitch)
    rudder = a.rudder_mix * aileron + scale * a.yaw_damper * (yaw_rate - r)
    m.aileron = min(max(aileron, -a.travel), a.travel)
    m.elevator = min(max(elevator, -a.travel), a.travel)
    m.rudder = min(max(rudder, -a.travel), a.travel)
    m.roll_rate, m.pitch_rate, m.yaw_rate = roll_rate, pitch_rate, yaw_rate
