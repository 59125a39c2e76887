"""Multirotors, their faults and their flights: what is drawn before the first step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_G: Final = 9.80665


class Frame(NamedTuple):
    """Arrangement of motors, in ArduPilot's order.

    Attributes
    ----------
    parameters
        FRAME_CLASS and FRAME_TYPE.
    angles_deg
        Clockwise from the nose.
    spins
        +1 for a propeller that turns counter-clockwise, whose reaction turns the craft clockwise.
    mav_type
        MAV_TYPE.
    """

    parameters: tuple[int, int]
    angles_deg: tuple[float, ...]
    spins: tuple[int, ...]
    mav_type: int

    @property
    def factors(self) -> Array:
        """Shares of the roll, pitch and yaw command in each motor's thrust, shape (motors, 3), at most 1."""
        angles = np.radians(self.angles_deg)
        factors = np.stack([-np.sin(angles), np.cos(angles), np.array(self.spins, dtype=float)], axis=1)
        scaled: Array = factors / np.abs(factors).max(axis=0)
        return scaled


FRAMES: Final = {
    "quad x": Frame((1, 1), (45, -135, -45, 135), (1, 1, -1, -1), 2),
    "quad +": Frame((1, 0), (90, -90, 0, 180), (1, 1, -1, -1), 2),
    "hexa x": Frame((2, 1), (90, -90, -30, 150, 30, -150), (-1, 1, -1, 1, 1, -1), 13),
    "hexa +": Frame((2, 0), (0, 180, -120, 60, -60, 120), (-1, 1, -1, 1, 1, -1), 13),
    "octa x": Frame(
        (3, 1),
        (22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5),
        (-1, -1, 1, 1, 1, 1, -1, -1),
        14,
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class Craft:
    """One aircraft; quantities in SI units, thrusts as shares of one motor's full thrust.

    Attributes
    ----------
    frame
        Its arrangement of motors.
    arm_m
        Distance of the motors from the centre.
    hover
        Thrust of each motor in a hover.
    inertia
        Moments of inertia about roll, pitch and yaw by mass and arm², shape (3,).
    reaction_m
        Torque of a propeller by its thrust.
    gains
        Thrust of each motor against the mean, shape (motors,).
    exponent
        Of the thrust by the command that the autopilot linearises to 1.
    lag_s
        Time constant of a motor.
    balance
        Centre of gravity forward and to the right, by arm, shape (2,).
    bandwidth
        Of the rate loops about roll, pitch and yaw, rad/s, shape (3,).
    mistuning
        What the autopilot takes for each axis's authority, by the true one, shape (3,).
    integral
        Integral by proportional gain of the rate loops, 1/s, shape (3,).
    drag
        Deceleration by airspeed, 1/s.
    flapping
        Angular acceleration of roll and pitch by airspeed, rad/(s·m).
    noise
        Standard deviation of angular acceleration by vibration and wash, rad/s², shape (3,).
    sag
        Loss of thrust over ten minutes.
    """

    frame: Frame
    arm_m: float
    hover: float
    inertia: Array
    reaction_m: float
    gains: Array
    exponent: float
    lag_s: float
    balance: Array
    bandwidth: Array
    mistuning: Array
    integral: Array
    drag: float
    flapping: float
    noise: Array
    sag: float

    @property
    def torques(self) -> Array:
        """Angular acceleration by each motor's thrust, rad/s², shape (motors, 3)."""
        angles = np.radians(self.frame.angles_deg)
        lever = np.stack(
            [
                -np.sin(angles) * self.arm_m,
                np.cos(angles) * self.arm_m,
                np.array(self.frame.spins) * self.reaction_m,
            ],
            axis=1,
        )
        accelerations: Array = lever * _G / (self.hover * angles.size) / (self.inertia * self.arm_m**2)
        return accelerations

    @property
    def authority(self) -> Array:
        """Angular acceleration by a unit of command, rad/s², shape (3,)."""
        authority: Array = (self.torques * self.frame.factors).sum(axis=0)
        return authority


class Event(NamedTuple):
    """What happens at a time: NaN and zeros where nothing does.

    Attributes
    ----------
    fault_s, motor, loss, by_propeller
        From then on this motor, from 0, has lost this share of its thrust, by its propeller or its speed.
    payload_s, mass, shift
        From then on the mass is this many times the first, its centre shifted by these shares of the arm.
    gust_s, gust_mps
        For ten seconds gusts have this standard deviation.
    """

    fault_s: float = np.nan
    motor: int = 0
    loss: float = 0.0
    by_propeller: bool = False
    payload_s: float = np.nan
    mass: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    gust_s: float = np.nan
    gust_mps: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """One flight: demands at 1 Hz, the air, and events.

    Attributes
    ----------
    duration_s
        From take-off, at 0 m.
    velocity
        Commanded velocity north, east and up, m/s, shape (seconds + 1, 3).
    yaw_rate
        Commanded, rad/s, shape (seconds + 1,).
    wind
        Mean wind to north and east, m/s.
    gust_mps
        Standard deviation of gusts.
    lands_s
        It descends from then on; NaN if it does not land.
    """

    duration_s: float
    velocity: Array
    yaw_rate: Array
    wind: tuple[float, float] = (0.0, 0.0)
    gust_mps: float = 0.0
    lands_s: float = np.nan
    event: Event = field(default_factory=Event)


def draw_craft(rng: np.random.Generator, name: str) -> Craft:
    """Return an aircraft with the frame ``name`` of :data:`FRAMES`."""
    frame = FRAMES[name]
    inertia = rng.uniform(0.16, 0.32)
    arm_m = rng.uniform(0.15, 0.45)
    return Craft(
        frame=frame,
        arm_m=arm_m,
        hover=rng.uniform(0.25, 0.55),
        inertia=inertia * np.array([1.0, rng.uniform(0.9, 1.3), rng.uniform(1.6, 2.0)]),
        reaction_m=arm_m * rng.uniform(0.05, 0.08),
        gains=rng.uniform(0.97, 1.03, len(frame.spins)),
        exponent=rng.uniform(0.85, 1.2),
        lag_s=rng.uniform(0.03, 0.08),
        balance=rng.uniform(-0.03, 0.03, 2),
        bandwidth=rng.uniform([8, 8, 3], [16, 16, 6]),
        mistuning=rng.uniform(0.8, 1.4, 3),
        integral=np.array([1.0, 1.0, 0.3]) * rng.uniform(0.5, 1.5),
        drag=rng.uniform(0.15, 0.4),
        flapping=rng.uniform(0.0, 0.4),
        noise=rng.uniform(0.2, 1.0) * np.array([1.0, 1.0, 0.15]),
        sag=rng.uniform(0.0, 0.2),
    )


def draw_plan(
    rng: np.random.Generator, duration_s: float, *, event: Event | None = None, lands: bool = False
) -> Plan:
    """Return a flight of hovers, legs, climbs and turns after a climb of 6 s."""
    seconds = int(duration_s) + 2
    velocity, yaw_rate = np.zeros((seconds, 3)), np.zeros(seconds)
    at = 10
    pace = rng.choice([0.0, 2.0, 5.0, 10.0])
    while at < seconds:
        lasts = int(rng.integers(4, 20))
        kind = rng.integers(4)
        if kind == 1:
            heading = rng.uniform(0, 2 * np.pi)
            velocity[at : at + lasts, :2] = pace * np.array([np.cos(heading), np.sin(heading)])
        elif kind == 2:
            velocity[at : at + lasts, 2] = rng.uniform(-1.5, 2.5)
        elif kind == 3:
            yaw_rate[at : at + lasts] = rng.uniform(-1.0, 1.0)
        at += lasts
    velocity[:8, 2] = 3.0
    heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0, 13) * rng.random()
    return Plan(
        duration_s=duration_s,
        velocity=velocity,
        yaw_rate=yaw_rate,
        wind=(speed * np.cos(heading), speed * np.sin(heading)),
        gust_mps=min(0.15 * speed + 0.1, 1.6),
        lands_s=duration_s - 30.0 if lands else np.nan,
        event=event or Event(),
    )
