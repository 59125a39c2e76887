"""One frame of the loop, 10 ms, as one compiled function: navigate, guide, control, actuate, propel."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._compiled import kernel
from mavhums_sim.closed_loop.aircraft import FRAME_S, STATES
from mavhums_sim.closed_loop.autopilot import CLIMB, STICKS, TRACK, attitude, guide
from mavhums_sim.closed_loop.surfaces import fail, follow, play

MEMORY = np.dtype(
    [
        (name, "f8")
        for name in (
            *("nav_roll", "nav_pitch", "throttle", "roll_rate", "pitch_rate", "yaw_rate"),
            *(
                "aileron",
                "elevator",
                "rudder",
                "roll_sum",
                "pitch_sum",
                "pitch_integral",
                "throttle_integral",
            ),
            *("course_error", "height_error", "speed_error", "north", "east", "leg_since", "thrust", "lost"),
        )
    ]
    + [("leg", "i8"), ("frame", "i8")]
)
_LOGGED = (
    *("north", "east", "nav_roll", "nav_pitch", "throttle", "roll_rate", "pitch_rate", "yaw_rate"),
    *("course_error", "height_error", "speed_error", "leg", "phase", "measured_airspeed", "thrust"),
)
COLUMNS = {name: k for k, name in enumerate((*STATES, *_LOGGED))}
"""Columns of the flight's log; behind them come the servos' demands, the surfaces' and the shafts' angles."""
ERRORS = ("roll", "pitch", "p", "q", "r", "airspeed")
"""Columns of the errors of what the autopilot measures."""
VEHICLE = np.dtype(
    [
        (name, "f8")
        for name in (
            *("rigged_elevator", "thrust", "torque", "engine_at", "engine_until", "engine_left"),
            *(
                "airspeed_at",
                "airspeed_until",
                "airspeed_reads",
                "gps_at",
                "gps_until",
                "gps_drift",
                "begin_s",
            ),
        )
    ]
)
"""What differs from flight to flight beside the gains: rigging, engine, sensors that fail."""

_FACTORS = np.array([factor for _, factor in STATES.values()])
_ROLL, _PITCH, _P, _Q, _R = 0, 1, 3, 4, 5
_AIRSPEED, _ALPHA, _BETA, _HEIGHT, _NORTH_SPEED, _EAST_SPEED, _DOWN_SPEED = range(6, 13)
_STATES = len(STATES)
_AIR_DENSITY = 1.225
_DIAMETER_M, _SUPPLY_V, _RESISTANCE, _IDLE_A = 0.508, 44.4, 0.042, 1.5
_KV = 60.0 / (2.0 * pi * 145.0)
_THRUST_COEFFICIENTS = (0.09357, -0.06044, -0.1079)
_TORQUE_COEFFICIENTS = (0.005230, 0.004970, -0.01664)
_POUND, _POUND_FOOT = 4.4482216152605, 1.3558179483314
_ENGINE_LAG_S = 0.2


@kernel
def propel(throttle: float, airspeed: float) -> tuple[float, float]:
    """Return thrust, N, and torque, N·m, of motor and propeller (Beard and McLain's supplement)."""
    volts = throttle * _SUPPLY_V
    d = _DIAMETER_M
    a = _AIR_DENSITY * d**5 / (2.0 * pi) ** 2 * _TORQUE_COEFFICIENTS[0]
    b = _AIR_DENSITY * d**4 / (2.0 * pi) * _TORQUE_COEFFICIENTS[1] * airspeed + _KV * _KV / _RESISTANCE
    c = (
        _AIR_DENSITY * d**3 * _TORQUE_COEFFICIENTS[2] * airspeed**2
        - _KV / _RESISTANCE * volts
        + _KV * _IDLE_A
    )
    speed = max((-b + sqrt(max(b * b - 4.0 * a * c, 0.0))) / (2.0 * a), 1.0)
    advance_ratio = 2.0 * pi * airspeed / (speed * d)
    disc = _AIR_DENSITY * (speed / (2.0 * pi)) ** 2 * d**4
    t0, t1, t2 = _THRUST_COEFFICIENTS
    q0, q1, q2 = _TORQUE_COEFFICIENTS
    thrust = disc * (t0 + t1 * advance_ratio + t2 * advance_ratio**2)
    torque = disc * d * (q0 + q1 * advance_ratio + q2 * advance_ratio**2)
    return max(thrust, -3.0), torque


@kernel
def _next_leg(legs: Any, m: Any, t: float, x: Array) -> None:
    """Begin the next leg when this one ends: by time, by passing its point, or at its height."""
    leg = legs[m.leg]
    over = leg.lasts > 0.0 and t - m.leg_since > leg.lasts
    if leg.kind == TRACK:
        ahead = atan2(leg.east - leg.east0, leg.north - leg.north0)
        left = cos(ahead) * (leg.north - m.north) + sin(ahead) * (leg.east - m.east)
        over = over or left < 25.0
    elif leg.kind == CLIMB:
        over = over or x[_HEIGHT] > leg.height - 15.0
    if over and m.leg + 1 < legs.size:
        m.leg += 1
        m.leg_since = t


@kernel
def _command(
    t: float, x: Array, error: Array, vehicle: Any, a: Any, legs: Any, stick: Array, m: Any
) -> float:
    """Run the autopilot on its measurements; return the measured airspeed."""
    _next_leg(legs, m, t, x)
    ground = hypot(x[_NORTH_SPEED], x[_EAST_SPEED])
    measured = x[_AIRSPEED] + error[5]
    used = measured
    if vehicle.airspeed_at <= t < vehicle.airspeed_until:
        measured *= vehicle.airspeed_reads
        used = measured if vehicle.airspeed_reads > 0.0 else ground
    if vehicle.gps_at <= t < vehicle.gps_until:
        m.lost += vehicle.gps_drift * 2.0 * FRAME_S
    course = atan2(x[_EAST_SPEED], x[_NORTH_SPEED])
    roll, pitch = x[_ROLL] + error[0], x[_PITCH] + error[1]
    position = (m.north + m.lost, m.east, x[_HEIGHT])
    guide(legs[m.leg], a, m, (*position, used, ground, course, -x[_DOWN_SPEED], roll), stick)
    attitude(a, m, (roll, pitch, x[_P] + error[2], x[_Q] + error[3], x[_R] + error[4], used))
    return float(measured)


@kernel
def advance(
    raw: Array,
    shafts: Array,
    log: Array,
    errors: Array,
    stick: Array,
    vehicle: Any,
    a: Any,
    legs: Any,
    m: Any,
    servos: Any,
    faults: Any,
    mixing: Array,
    effect: Array,
    out: Array,
) -> float:
    """Advance by one frame; fill the log's row and the inputs ``out`` for the next; return the height.

    Parameters
    ----------
    raw
        :meth:`Aircraft.read`.
    shafts
        Angles of the servos' shafts, rad, shape (n,); NaN for servos of reduced order.
    log
        Shape (frames, columns + 3 × surfaces), SI.
    errors, stick
        At 50 Hz: shapes (frames/2, 6) and (frames/2, 2).
    servos, faults
        One row per surface.
    mixing, effect
        Shapes (n, 3) and (3, n); see :class:`~mavhums_sim.closed_loop.surfaces.Layout`.
    out
        Inputs of JSBSim: aileron, elevator, rudder, thrust and torque; shape (5,).
    """
    v, pilot, memory = vehicle[0], a[0], m[0]
    k = memory.frame
    x = log[k]
    for j in range(_STATES):
        x[j] = raw[j] * _FACTORS[j]
    t = v.begin_s + k * FRAME_S
    memory.north += x[_NORTH_SPEED] * FRAME_S
    memory.east += x[_EAST_SPEED] * FRAME_S
    n = servos.size
    first = _STATES + 15
    if k % 2 == 0:
        half = k // 2
        x[_STATES + 13] = _command(t, x, errors[half], v, pilot, legs, stick[half], memory)
        for s in range(n):
            demand = (
                mixing[s, 0] * memory.aileron + mixing[s, 1] * memory.elevator + mixing[s, 2] * memory.rudder
            )
            x[first + s] = min(max(demand, -pilot.travel), pilot.travel)
    else:
        x[_STATES + 13] = log[k - 1, _STATES + 13]
        x[first : first + n] = log[k - 1, first : first + n]
    _actuate(t, x, first, log[k - 1] if k else x, shafts, servos, faults)
    for axis in range(3):
        out[axis] = 0.0
        for s in range(n):
            out[axis] += effect[axis, s] * x[first + n + s]
    out[1] = v.rigged_elevator - out[1]
    out[2] = -out[2]
    thrust, torque = propel(memory.throttle, x[_AIRSPEED])
    left = v.engine_left if v.engine_at <= t < v.engine_until else 1.0
    memory.thrust += (left * thrust * v.thrust - memory.thrust) * FRAME_S / _ENGINE_LAG_S
    out[3] = memory.thrust / _POUND
    out[4] = left * torque * v.torque / _POUND_FOOT
    _note(x, memory, legs)
    memory.frame += 1
    return float(x[_HEIGHT])


@kernel
def _actuate(t: float, x: Array, first: int, before: Array, shafts: Array, servos: Any, faults: Any) -> None:
    """Move servos and surfaces: columns demand, angle and servo from ``first`` on, n each."""
    n = servos.size
    for s in range(n):
        servo = servos[s]
        shaft = shafts[s]
        if np.isnan(shaft):
            shaft = follow(servo, before[first + 2 * n + s], x[first + s], FRAME_S)
        angle = before[first + n + s]
        fault = faults[s]
        healthy = shaft + servo.trim
        if fault.kind and fault.at <= t < fault.until:
            stream = servo.streams_with_alpha * x[_ALPHA] + servo.streams_with_beta * x[_BETA]
            angle = fail(fault, angle, healthy, stream, FRAME_S)
        else:
            angle = play(angle, healthy, 0.5 * servo.play)
        x[first + 2 * n + s] = shaft
        x[first + n + s] = angle


@kernel
def _note(x: Array, m: Any, legs: Any) -> None:
    j = _STATES
    x[j], x[j + 1], x[j + 2], x[j + 3], x[j + 4] = m.north, m.east, m.nav_roll, m.nav_pitch, m.throttle
    x[j + 5], x[j + 6], x[j + 7] = m.roll_rate, m.pitch_rate, m.yaw_rate
    x[j + 8], x[j + 9], x[j + 10] = m.course_error, m.height_error, m.speed_error
    x[j + 11], x[j + 12], x[j + 14] = m.leg, legs[m.leg].phase, m.thrust
    if legs[m.leg].kind == STICKS:
        x[j + 8] = 0.0
