"""Drives a rover or a boat that steers by one servo, in closed loop, and writes its ``.tlog``.

The vehicle turns by ``r = K·v·δ / (1 + (v / v_c)²)``, with a lag, over rough ground or in waves. A boat
drifts with a current besides, before the wind across its heading, and out of its turns. The autopilot is of
the usual kind: way to the next waypoint → yaw rate → steering, by feed-forward and a PI loop; it slows down
in turns, stops now and then and backs up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._compiled import kernel
from mavhums_sim._files import written_whole
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.tables import Table, boot_ms, boot_us, text_rows, whole
from mavhums_sim.link import Link

Array = NDArray[np.float64]
LOGGED_HZ: Final = 50
_STEPS: Final = 2  # per logged sample
_DT: Final = 1.0 / (LOGGED_HZ * _STEPS)
_REST_S: Final = 15.0
_ARDUPILOT: Final = 3
_ARMED: Final = 128 + 1
_AUTO: Final = 10
_SCALE_MG: Final = 1000 / 9.80665
_LOW_US, _TRIM_US, _HIGH_US = 1100.0, 1500.0, 1900.0

PARAMETERS: Final[Mapping[str, float]] = {
    "CRUISE_THROTTLE": 50.0,
    "SERVO1_FUNCTION": 26.0,
    "SERVO1_MIN": _LOW_US,
    "SERVO1_TRIM": _TRIM_US,
    "SERVO1_MAX": _HIGH_US,
    "SERVO3_FUNCTION": 70.0,
}


class SteeringFault(NamedTuple):
    """What fails at a time; NaN where nothing does.

    Attributes
    ----------
    start_s
        From then on, after the first motion.
    left
        Share of the deflection that is left.
    frozen
        Whether the servo stays where it is.
    """

    start_s: float = np.nan
    left: float = 1.0
    frozen: bool = False


@dataclass(frozen=True, slots=True)
class Rover:
    """One vehicle and the ground or water that it is on; SI units.

    Attributes
    ----------
    boat
        Whether it is a boat.
    gain
        Curvature by full steering, 1/m.
    characteristic_mps
        Speed at which half of this is left; infinite for a neutral vehicle.
    lag_s, servo_lag_s, servo_rate
        Lag of the yaw rate and of the servo, s; travel of the servo each second, of half of the whole.
    trim, play
        Steering at zero deflection, and the play of the linkage, of half of the travel.
    rough
        Standard deviation of the yaw rate by ground or waves at 1 m/s, rad/s.
    speed_mps, current_mps
        Cruise speed; drift to north and east.
    tuning
        Gain that the autopilot takes for the vehicle's, by the true one.
    leeway_mps
        What the wind would push a boat to north and east; only the part across its heading does.
    slip_m
        Speed out of a turn, by the yaw rate.
    compass_rad
        Error of the heading that is recorded.
    """

    boat: bool = False
    gain: float = 0.8
    characteristic_mps: float = np.inf
    lag_s: float = 0.15
    servo_lag_s: float = 0.05
    servo_rate: float = 6.0
    trim: float = 0.0
    play: float = 0.0
    rough: float = 0.02
    speed_mps: float = 2.5
    current_mps: tuple[float, float] = (0.0, 0.0)
    tuning: float = 1.0
    leeway_mps: tuple[float, float] = (0.0, 0.0)
    slip_m: float = 0.0
    compass_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """A drive at :data:`LOGGED_HZ`: steering asked for, yaw, yaw rate, velocity over ground, position."""

    rover: Rover
    time_s: Array
    steering: Array
    yaw: Array
    yaw_rate: Array
    velocity: Array
    position: Array
    speed: Array = field(repr=False)


def draw_rover(rng: np.random.Generator, *, boat: bool) -> Rover:
    """Return a vehicle, its ground and its water, of those that are usual."""
    drift = rng.uniform(0.0, 0.4) if boat else 0.0
    way = rng.uniform(0.0, 2 * np.pi)
    rover = Rover(
        boat=boat,
        gain=rng.uniform(0.25, 1.5),
        characteristic_mps=rng.uniform(4.0, 12.0),
        lag_s=rng.uniform(0.15, 0.4) if boat else rng.uniform(0.05, 0.2),
        servo_lag_s=rng.uniform(0.03, 0.08),
        servo_rate=rng.uniform(4.0, 10.0),
        trim=rng.uniform(-0.08, 0.08),
        play=rng.uniform(0.0, 0.03),
        rough=rng.uniform(0.005, 0.03),
        speed_mps=rng.uniform(1.2, 5.0),
        current_mps=(drift * np.cos(way), drift * np.sin(way)),
        tuning=rng.uniform(0.6, 1.6),
        compass_rad=rng.normal(0.0, 0.07),
    )
    pushed, way = rng.uniform(0.0, 0.3), rng.uniform(0.0, 2 * np.pi)
    leeway = (pushed * np.cos(way), pushed * np.sin(way))
    return replace(rover, leeway_mps=leeway, slip_m=rng.uniform(0.0, 0.6)) if boat else rover


def drive(rover: Rover, duration_s: float, seed: int, fault: SteeringFault | None = None) -> Driven:
    """Drive between random waypoints; ``seed`` draws them, the ground and the waves."""
    rng = np.random.default_rng([seed, 7])
    fault = fault or SteeringFault()
    rows = np.empty((int(duration_s * LOGGED_HZ), 7))
    reach = rng.uniform(4.0, 20.0) * rover.speed_mps
    settings = np.array(
        [
            rover.gain, rover.characteristic_mps, rover.lag_s, rover.servo_lag_s, rover.servo_rate,
            rover.trim, rover.play, rover.rough, rover.speed_mps, *rover.current_mps, rover.tuning,
            fault.start_s, fault.left, float(fault.frozen), reach, 2.0 if rover.boat else 0.5,
            *rover.leeway_mps, rover.slip_m,
        ]
    )  # fmt: skip
    _drive(settings, rng, rows)
    return Driven(
        rover, np.arange(len(rows)) / LOGGED_HZ, rows[:, 0], rows[:, 1], rows[:, 2],
        rows[:, 3:5], rows[:, 5:7], np.hypot(rows[:, 3], rows[:, 4]),
    )  # fmt: skip


@kernel
def _drive(settings: Array, rng: np.random.Generator, rows: Array) -> None:
    gain, characteristic, lag, servo_lag, servo_rate, trim, play, rough, cruise = settings[0:9]
    drift_n, drift_e, tuning, fault_s, left, frozen, reach, memory_s, lee_n, lee_e, slip = settings[9:20]
    north, east, yaw, speed, rate = 0.0, 0.0, 0.0, 0.0, 0.0
    servo, surface, memory, bump, asked = 0.0, 0.0, 0.0, 0.0, 0.0
    goal_n, goal_e = reach, 0.0
    rest_s, wait, back = 40.0 + 60.0 * rng.random(), 0.0, 0.0
    for step in range(rows.shape[0] * _STEPS):
        t = step * _DT
        if np.hypot(goal_n - north, goal_e - east) < max(1.5, cruise):
            way = yaw + (rng.random() - 0.5) * 2.0 * np.pi * 0.8
            far = reach * (0.4 + rng.random())
            goal_n, goal_e = north + far * np.cos(way), east + far * np.sin(way)
        # Now and then it stops, and backs up as often.
        rest_s -= _DT
        if rest_s < 0.0:
            rest_s, wait = 40.0 + 120.0 * rng.random(), 4.0
            back = 3.0 if rng.random() < 0.5 else 0.0
        wait, want = max(wait - _DT, 0.0), cruise
        if wait > 0.0:
            want = 0.0
        elif back > 0.0:
            back, want = back - _DT, -0.5 * cruise
        off = np.arctan2(goal_e - east, goal_n - north) - yaw
        off = (off + np.pi) % (2.0 * np.pi) - np.pi
        if want > 0.0:
            want = max(cruise * (1.0 - 0.5 * min(abs(off), 1.0)), 0.8)
        if step % 2 == 0:
            turn = min(max(1.2 * off, -1.5), 1.5)
            v = max(abs(speed), 0.5)
            error = turn - rate
            memory = min(max(memory + 0.3 * error * 2.0 * _DT, -0.4), 0.4) if abs(speed) > 0.3 else 0.0
            asked = (turn + 0.3 * error + memory) / (gain * tuning * v)
            asked = min(max(asked if want >= 0.0 else 0.0, -1.0), 1.0)
        if not (frozen > 0.0 and t >= fault_s):
            move = (asked - servo) / servo_lag
            servo += min(max(move, -servo_rate), servo_rate) * _DT
        # The linkage follows when its play is used up.
        surface = min(max(surface, servo - play), servo + play)
        given = surface * (left if t >= fault_s else 1.0) + trim
        speed += (want - speed) / 0.8 * _DT
        bump += -bump * _DT / memory_s + rough * np.sqrt(2.0 * _DT / memory_s) * rng.standard_normal()
        steady = gain * speed * given / (1.0 + (speed / characteristic) ** 2)
        rate += (steady - rate) / lag * _DT
        seen = rate + bump * max(abs(speed), 0.2)
        yaw += seen * _DT
        c, s = np.cos(yaw), np.sin(yaw)
        across = lee_e * c - lee_n * s - slip * seen
        vel_n, vel_e = speed * c - across * s + drift_n, speed * s + across * c + drift_e
        north, east = north + vel_n * _DT, east + vel_e * _DT
        if step % _STEPS == 0:
            row = rows[step // _STEPS]
            row[0], row[1], row[2] = asked, yaw, seen
            row[3], row[4], row[5], row[6] = vel_n, vel_e, north, east


def encoded(
    driven: Driven, rate_hz: float = 10.0, seed: int = 0, *, parameters: Mapping[str, float] = PARAMETERS
) -> bytes:
    """Return the drive's ``.tlog``: parameters come first, and the vehicle is at rest for 15 s.

    Parameters
    ----------
    driven
        The drive.
    rate_hz
        Rate of the outputs, the attitude and the gyro; positions come at 4 Hz at most.
    seed
        Draws the times of sampling and the receiver's noise.
    parameters
        Those that the ground station downloads.
    """
    rng = np.random.default_rng([seed, 8])
    end_s = _REST_S + driven.time_s[-1]
    beats = np.arange(0.0, end_s, 1.0)
    count = len(parameters)
    values = {
        "param_id": np.array([name.encode() for name in parameters], "S16"),
        "param_value": np.array(list(parameters.values())),
        "param_type": 9,
        "param_count": count,
        "param_index": np.arange(count),
    }
    heartbeat = {
        "type": 11 if driven.rover.boat else 10,
        "autopilot": _ARDUPILOT,
        "base_mode": np.where(beats < 8.0, 1, _ARMED),
        "custom_mode": _AUTO,
        "mavlink_version": 3,
    }

    def sampled(hz: float) -> tuple[Array, NDArray[np.int64], Array]:
        times = np.arange(rng.uniform(0, 1 / hz), end_s - 0.1, 1 / hz)
        times = np.clip(times + rng.uniform(-0.1, 0.1, times.size) / hz, 0.0, None)
        rows = np.clip(((times - _REST_S) * LOGGED_HZ).astype(np.int64), 0, driven.time_s.size - 1)
        return times, rows, (times >= _REST_S).astype(float)

    tables = [
        Table("HEARTBEAT", beats, heartbeat),
        Table("PARAM_VALUE", np.linspace(0.5, 2.0, count), values),
        text_rows([(0.4, "ArduRover V4.5.7 (simulated)")]),
    ]
    times, rows, moves = sampled(rate_hz)
    sent = np.rint(_TRIM_US + (_HIGH_US - _TRIM_US) * driven.steering[rows] * moves)
    throttle = np.rint(1500.0 + 200.0 * moves)
    outputs = {"time_usec": boot_us(times) % 2**32, "servo1_raw": sent, "servo3_raw": throttle}
    tables.append(Table("SERVO_OUTPUT_RAW", times, outputs))
    times, rows, moves = sampled(rate_hz)
    yaw = np.angle(np.exp(1j * (driven.yaw[rows] + driven.rover.compass_rad)))
    turning = {"time_boot_ms": boot_ms(times), "yaw": yaw, "yawspeed": driven.yaw_rate[rows] * moves}
    tables.append(Table("ATTITUDE", times, turning))
    times, rows, moves = sampled(rate_hz)
    gyro = driven.yaw_rate[rows] * moves + rng.normal(0.0, 0.004, times.size)
    imu = {"time_usec": boot_us(times), "zgyro": whole(gyro * 1000), "zacc": int(-_SCALE_MG * 9.80665)}
    tables.append(Table("RAW_IMU", times, imu))
    times, rows, moves = sampled(min(rate_hz, 4.0))
    velocity = driven.velocity[rows] * moves[:, None] + rng.normal(0.0, 0.05, (times.size, 2))
    where = {
        "time_boot_ms": boot_ms(times),
        "lat": whole(47e7 + driven.position[rows, 0] * 90.0, -(2**31), 2**31 - 1),
        "lon": whole(8e7 + driven.position[rows, 1] * 130.0, -(2**31), 2**31 - 1),
        "vx": whole(velocity[:, 0] * 100),
        "vy": whole(velocity[:, 1] * 100),
    }
    tables.append(Table("GLOBAL_POSITION_INT", times, where))
    hud = {"groundspeed": np.hypot(*velocity.T)}
    tables.append(Table("VFR_HUD", times, hud))
    return encode(tables, seed, Link())


def write_tlog(driven: Driven, path: Path, rate_hz: float = 10.0, seed: int = 0) -> None:
    """Write a drive's ``.tlog`` atomically, as :func:`encoded` has it.

    Raises
    ------
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    data = encoded(driven, rate_hz, seed)
    with written_whole(path) as temporary:
        temporary.write_bytes(data)
