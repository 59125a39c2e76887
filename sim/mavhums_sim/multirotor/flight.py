"""Flies a multirotor in closed loop: rigid body, motors, air, and an autopilot of cascaded loops.

The autopilot is of the usual kind: velocity → lean → rates → commands of roll, pitch and yaw → mixer, which
gives up yaw first and then height where the thrust does not suffice. Angular accelerations are integrated by
symplectic Euler at 200 Hz; motors are first-order lags by their exact step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._compiled import kernel
from mavhums_sim.multirotor.craft import Craft, Plan

Array = NDArray[np.float64]
LOGGED_HZ: Final = 100
_STEPS: Final = 2  # per logged sample
_DT: Final = 1.0 / (LOGGED_HZ * _STEPS)
_G: Final = 9.80665
_LEVEL_DEG: Final = 35.0  # most lean that is commanded
_ANGLE_GAIN: Final = 4.5  # 1/s, ArduPilot's default
_SPEED_GAIN: Final = 1.0  # 1/s
_CLIMB_GAIN: Final = 2.5  # 1/s
_LOWEST_M: Final = 4.0  # it climbs rather than flies into the ground before it lands
_SPOOLS_DOWN: Final = 0.5  # thrust by hover thrust that it loses each second after touch-down
_AFTER_S: Final = 2.0  # the record goes on for as long after touch-down
_RATES: Final = 17  # columns of the record before the motors' commands


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A flight at :data:`LOGGED_HZ`, until it ended or hit the ground.

    Attributes
    ----------
    craft, plan
        What flew.
    time_s
        Shape (n,).
    attitude, rates
        Roll, pitch, yaw, rad, and body rates, rad/s, shape (n, 3).
    position, velocity
        North, east, up, m and m/s, shape (n, 3).
    force
        Specific force forward, right, down, m/s², shape (n, 3).
    command
        Thrust asked of each motor, a share from 0 to 1, shape (n, motors).
    wanted
        Commanded roll and pitch, rad, shape (n, 2).
    """

    craft: Craft
    plan: Plan
    time_s: Array
    attitude: Array
    rates: Array
    position: Array
    velocity: Array
    force: Array
    command: Array
    wanted: Array


def fly(craft: Craft, plan: Plan, seed: int) -> Flown:
    """Fly a plan; ``seed`` draws the gusts and the noise."""
    rng = np.random.default_rng([seed, 5])
    samples = int(plan.duration_s * LOGGED_HZ)
    rows = np.empty((samples, _RATES + craft.gains.size))
    event = plan.event
    settings = np.array(
        [
            craft.hover, craft.exponent, craft.lag_s, craft.drag, craft.flapping, craft.sag,
            plan.wind[0], plan.wind[1], plan.gust_mps, plan.lands_s,
            event.fault_s, float(event.motor), event.loss,
            event.payload_s, event.mass, event.shift[0], event.shift[1], event.gust_s, event.gust_mps,
            craft.balance[0], craft.balance[1], craft.arm_m,
        ]
    )  # fmt: skip
    loops = np.stack([craft.bandwidth, craft.authority * craft.mistuning, craft.integral, craft.noise])
    used = _fly(
        settings, craft.frame.factors, craft.torques, craft.gains, loops, craft.inertia,
        plan.velocity, plan.yaw_rate, rng, rows,
    )  # fmt: skip
    rows = rows[:used]
    return Flown(
        craft, plan, np.arange(used) / LOGGED_HZ,
        rows[:, 0:3], rows[:, 3:6], rows[:, 6:9], rows[:, 9:12], rows[:, 12:15], rows[:, _RATES:],
        rows[:, 15:17],
    )  # fmt: skip


@kernel
def _fly(
    settings: Array,
    factors: Array,
    torques: Array,
    gains: Array,
    loops: Array,
    inertia: Array,
    demanded: Array,
    turns: Array,
    rng: np.random.Generator,
    rows: Array,
) -> int:
    hover, exponent, lag_s, drag, flapping, sag = settings[0:6]
    fault_s, motor, loss = settings[10], int(settings[11]), settings[12]
    motors = gains.size
    roll, pitch, yaw = 0.0, 0.0, 0.0
    rate, memory = np.zeros(3), np.zeros(3)
    where, speed = np.zeros(3), np.zeros(3)
    gust, wash = np.zeros(3), np.zeros(3)
    thrust, asked = np.full(motors, 0.8 * hover), np.full(motors, 0.8 * hover)
    wanted_roll, wanted_pitch, lift_memory = 0.0, 0.0, 0.0
    keep, touched = np.exp(-_DT / lag_s), np.nan
    for step in range(rows.shape[0] * _STEPS):
        t = step * _DT
        second = int(t)
        gone = t >= settings[13]
        mass = settings[14] if gone else 1.0
        fore = settings[19] + (settings[15] if gone else 0.0)
        side = settings[20] + (settings[16] if gone else 0.0)
        # Air: gusts with a memory of 2 s.
        strength = settings[8]
        if settings[17] <= t < settings[17] + 10.0:
            strength = settings[18]
        for k in range(3):
            part = strength * (1.0 if k < 2 else 0.5)
            gust[k] += -gust[k] * _DT / 2.0 + part * np.sqrt(2 * _DT / 2.0) * rng.standard_normal()
        air_n, air_e = settings[6] + gust[0] - speed[0], settings[7] + gust[1] - speed[1]
        air_up = gust[2] - speed[2]
        # Autopilot: velocity → lean, every fourth step.
        if step % 4 == 0:
            want_n, want_e, want_up = demanded[second, 0], demanded[second, 1], demanded[second, 2]
            if t >= settings[9]:
                want_n, want_e, want_up = 0.0, 0.0, -2.0 if where[2] > 6.0 else -0.6
            elif where[2] < _LOWEST_M:
                want_up = max(want_up, 0.0)
            most = np.tan(np.radians(_LEVEL_DEG)) * _G
            a_n = min(max(_SPEED_GAIN * (want_n - speed[0]), -most), most)
            a_e = min(max(_SPEED_GAIN * (want_e - speed[1]), -most), most)
            ahead, right = a_n * np.cos(yaw) + a_e * np.sin(yaw), a_e * np.cos(yaw) - a_n * np.sin(yaw)
            limit = np.radians(_LEVEL_DEG)
            # The demand turns at a limited rate, as input shaping has it.
            wanted_pitch += min(max(np.arctan(-ahead / _G) - wanted_pitch, -0.02), 0.02)
            wanted_roll += min(max(np.arctan(right / _G) - wanted_roll, -0.02), 0.02)
            wanted_pitch = min(max(wanted_pitch, -limit), limit)
            wanted_roll = min(max(wanted_roll, -limit), limit)
            short = want_up - speed[2]
            lift_memory = min(max(lift_memory + 0.5 * short * 4 * _DT, -3.0), 6.0)
            tilt = max(np.cos(roll) * np.cos(pitch), 0.6)
            lift = hover * (1.0 + (_CLIMB_GAIN * short + lift_memory) / _G) / tilt
            lift = min(max(lift, 0.1), 0.95)
            if not np.isnan(touched):
                lift = hover * max(0.9 - _SPOOLS_DOWN * (t - touched), 0.05)
        # Rates → commands.
        want = np.array(
            [
                _ANGLE_GAIN * (wanted_roll - roll),
                _ANGLE_GAIN * (wanted_pitch - pitch),
                turns[second] if t < settings[9] or np.isnan(settings[9]) else 0.0,
            ]
        )
        command = np.zeros(3)
        for k in range(3):
            error = want[k] - rate[k]
            memory[k] = min(max(memory[k] + loops[2, k] * error * _DT, -4.0), 4.0)
            command[k] = loops[0, k] * (error + memory[k]) / loops[1, k]
            command[k] = min(max(command[k], -1.0), 1.0)
        _mix(lift, command, factors, asked)
        # Motors and body.
        weak = 1.0 - sag * t / 600.0
        ground = 1.0 + 0.15 * np.exp(-max(where[2], 0.0) / 0.4)
        total = 0.0
        spin = np.zeros(3)
        for i in range(motors):
            given = hover * (asked[i] / hover) ** exponent * gains[i] * weak * ground
            if i == motor and t >= fault_s:
                given *= 1.0 - loss
            thrust[i] = given + (thrust[i] - given) * keep
            total += thrust[i]
            for k in range(3):
                spin[k] += torques[i, k] * thrust[i]
        total /= motors * hover  # of the first weight
        # The thrust acts beside the centre of gravity.
        lever = _G * total / settings[21]
        spin[0] += lever * side / inertia[0]
        spin[1] -= lever * fore / inertia[1]
        body_ahead = air_n * np.cos(yaw) + air_e * np.sin(yaw)
        body_right = air_e * np.cos(yaw) - air_n * np.sin(yaw)
        # Flapping leans the rotors away from the wind.
        spin[0] += flapping * body_right
        spin[1] += flapping * body_ahead
        descending = max(-speed[2] - 0.5, 0.0)
        for k in range(3):
            wash[k] += (
                -wash[k] * _DT / 0.1
                + loops[3, k] * (1.0 + 2.0 * descending) * np.sqrt(2 * _DT / 0.1) * rng.standard_normal()
            )
            spin[k] += wash[k]
        spin[2] -= 0.5 * rate[2]
        spin[0] -= 0.5 * rate[0]
        spin[1] -= 0.5 * rate[1]
        # Euler's term is small beside the motors' torques.
        for k in range(3):
            rate[k] += spin[k] * _DT
        cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
        safe = cp if abs(cp) > 0.05 else 0.05
        turn = (sr * rate[1] + cr * rate[2]) / safe
        roll += (rate[0] + sp * turn) * _DT
        pitch += (cr * rate[1] - sr * rate[2]) * _DT
        yaw += turn * _DT
        pull = _G * total / mass
        cy, sy = np.cos(yaw), np.sin(yaw)
        acc_n = -pull * (cr * sp * cy + sr * sy) + drag * air_n
        acc_e = -pull * (cr * sp * sy - sr * cy) + drag * air_e
        acc_up = pull * cr * cp - _G + drag * air_up
        speed[0] += acc_n * _DT
        speed[1] += acc_e * _DT
        speed[2] += acc_up * _DT
        where += speed * _DT
        if where[2] <= 0.0:
            if t > 5.0 and (speed[2] < -3.0 or abs(roll) > 0.5 or abs(pitch) > 0.5):
                return step // _STEPS
            where[2], speed[:] = 0.0, np.maximum(speed, 0.0) * 0.0
            roll, pitch, rate[:] = roll * 0.9, pitch * 0.9, rate * 0.5
            if t >= settings[9] and np.isnan(touched):
                touched = t
        if t > touched + _AFTER_S:
            return step // _STEPS
        if step % _STEPS == 0:
            row = rows[step // _STEPS]
            row[0], row[1], row[2] = roll, pitch, yaw
            row[3:6], row[6:9], row[9:12] = rate, where, speed
            row[12], row[13] = drag * body_ahead, drag * body_right
            row[14] = -pull
            row[15], row[16] = wanted_roll, wanted_pitch
            row[_RATES:] = asked
        if abs(roll) > 3.0 or abs(pitch) > 1.5:
            return step // _STEPS
    return len(rows)


@kernel
def _mix(lift: float, command: Array, factors: Array, asked: Array) -> None:
    """Share commands out to motors, within 0 and 1: roll and pitch first, then yaw, then height."""
    motors = asked.size
    low, high = 0.0, 0.0
    for i in range(motors):
        asked[i] = factors[i, 0] * command[0] + factors[i, 1] * command[1]
        low, high = min(low, asked[i]), max(high, asked[i])
    scale = 1.0 / (high - low) if high - low > 1.0 else 1.0
    room = max((1.0 - scale * (high - low)) / 2.0, 0.1)
    yaw = min(max(command[2], -room), room)
    low, high = 1e9, -1e9
    for i in range(motors):
        asked[i] = scale * asked[i] + factors[i, 2] * yaw
        low, high = min(low, asked[i]), max(high, asked[i])
    base = min(max(lift, -low), max(1.0 - high, -low))
    for i in range(motors):
        asked[i] = min(max(base + asked[i], 0.01), 1.0)
