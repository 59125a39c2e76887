"""The telemetry tiers by which an aircraft reports its actuators, alone or together.

instrumented
    DEBUG_FLOAT_ARRAY named EMA with V1…V12 (one message per servo).
esc-signed
    ESC_STATUS with speed, voltage and current of four ESCs, signed.
esc-info
    ESC_INFO once a second: the flag of a stuck motor, a count of these, the winding's temperature.
esc-unsigned
    ESC_TELEMETRY_1_TO_4: magnitudes in 10 mV, 10 mA and 1 rev/min, no time stamp.
named
    NAMED_VALUE_FLOAT ``S<servo>V01`` … ``S<servo>V12``, times in milliseconds.
position
    Of these ``S<servo>V01`` and ``S<servo>V03`` alone, as a servo reports that measures only its angle.
pwm
    SERVO_OUTPUT_RAW: the commanded pulses.

An on-board log has csrv as well (:mod:`mavhums_sim.dataflash`), which no link carries.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim._arrays import Array
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.esc_status import EscInfo, EscStatus
from mavhums_sim.flight import ActuatorRecord, FlightRecord
from mavhums_sim.link import BOOT_US
from mavhums_sim.sensors import sample_times

MOTOR_STUCK = 32  # ESC_FAILURE_FLAGS
_PWM_TRIM, _PWM_PER_DEGREE = 1500.0, 500.0 / 60.0

Message = Any


@dataclass(frozen=True, slots=True)
class Stream:
    """One message type: times of sending, s, and a function that builds its k-th message.

    So many messages ``together`` are one sample, of which a slow link carries all or none.
    """

    times: Array
    build: Callable[[int], Message]
    together: int = 1


def actuator_streams(record: FlightRecord) -> list[Stream]:
    """Return the streams of every tier that the flight carries.

    Raises
    ------
    ValueError
        If there is no such tier.
    """
    unknown = set(record.flight.tiers) - set(TIERS)
    if unknown:
        raise ValueError(f"no telemetry tier {sorted(unknown)[0]!r}; there are {', '.join(TIERS)}")
    return [stream for tier in TIERS if tier in record.flight.tiers for stream in TIERS[tier](record)]


def _instrumented(record: FlightRecord) -> list[Stream]:
    return [_float_array(actuator, k) for k, actuator in enumerate(record.actuators.values(), start=1)]


def _float_array(actuator: ActuatorRecord, servo: int) -> Stream:
    spare = [0.0] * 46
    return Stream(
        actuator.time_s,
        lambda k: mavlink.MAVLink_debug_float_array_message(
            BOOT_US + round(actuator.time_s[k] * 1e6), b"EMA", servo, actuator.values[k].tolist() + spare
        ),
    )


def _esc_signed(record: FlightRecord) -> list[Stream]:
    times = _times(record, 8, record.flight.rate_hz)
    rpm, volts, amperes = (_esc(record, times, column, np.asarray) for column in (2, 0, 1))
    speed = np.rint(rpm).astype(int)

    def build(k: int) -> Message:
        time_us = BOOT_US + round(float(times[k]) * 1e6)
        return EscStatus(0, time_us, speed[k].tolist(), volts[k].tolist(), amperes[k].tolist())

    return [Stream(times, build)]


def _esc_info(record: FlightRecord) -> list[Stream]:
    times, of_type = _times(record, 12, 1.0), record.flight.parameters
    stuck = np.stack([a.stuck(of_type, times) for a in record.actuators.values()], axis=1)
    warmth = np.stack([a.temperature(of_type, times) for a in record.actuators.values()], axis=1)
    flags, errors = stuck * MOTOR_STUCK, stuck.cumsum(axis=0)
    cdegrees = np.clip(np.rint(warmth * 100), -32768, 32766).astype(int)

    def build(k: int) -> Message:
        time_us = BOOT_US + round(float(times[k]) * 1e6)
        return EscInfo(time_us, errors[k].tolist(), flags[k].tolist(), cdegrees[k].tolist())

    return [Stream(times, build)]


def _esc_unsigned(record: FlightRecord) -> list[Stream]:
    times = _times(record, 9, record.flight.rates.esc)
    centivolts, centiamperes, speed = (
        np.clip(np.rint(_esc(record, times, column, np.abs) * scale), 0, 65535).astype(int)
        for column, scale in ((0, 100.0), (1, 100.0), (2, 1.0))
    )

    warmth = [a.temperature(record.flight.parameters, times) for a in record.actuators.values()]
    degrees = np.clip(np.rint(np.stack(warmth, axis=1)), 0, 255).astype(int)

    def build(k: int) -> Message:
        return mavlink.MAVLink_esc_telemetry_1_to_4_message(
            degrees[k].tolist(),
            centivolts[k].tolist(),
            centiamperes[k].tolist(),
            [0] * 4,
            speed[k].tolist(),
            [k % 65536] * 4,
        )

    return [Stream(times, build)]


def _named(record: FlightRecord) -> list[Stream]:
    return _named_values(record, range(1, 13))


def _position(record: FlightRecord) -> list[Stream]:
    return _named_values(record, (1, 3))


def _named_values(record: FlightRecord, quantities: Sequence[int]) -> list[Stream]:
    return [_values_of(actuator, n, quantities) for n, actuator in enumerate(record.actuators.values(), 1)]


def _values_of(actuator: ActuatorRecord, servo: int, quantities: Sequence[int]) -> Stream:
    count = len(quantities)

    def build(k: int) -> Message:
        sample, quantity = divmod(k, count)
        time_ms = (BOOT_US + round(float(actuator.time_s[sample]) * 1e6)) // 1000
        name = f"S{servo}V{quantities[quantity]:02d}".encode()
        value = float(actuator.values[sample, quantities[quantity] - 1])
        return mavlink.MAVLink_named_value_float_message(time_ms, name, value)

    return Stream(np.repeat(actuator.time_s, count), build, count)


def _pwm(record: FlightRecord) -> list[Stream]:
    times = _times(record, 10, record.flight.rates.servo_output)
    pulses = servo_pulses(record, times)

    def build(k: int) -> Message:
        time_us = (BOOT_US + round(float(times[k]) * 1e6)) % 2**32
        return mavlink.MAVLink_servo_output_raw_message(
            time_us, 0, *(round(float(pulse)) for pulse in pulses[k]), *[0] * (16 - len(SURFACES))
        )

    return [Stream(times, build)]


def servo_pulses(record: FlightRecord, times: Array) -> Array:
    """Return the commanded pulses at other times, µs, shape (n, 4)."""
    commands = [
        np.interp(times, a.motion.time_s, np.degrees(a.motion.command)) for a in record.actuators.values()
    ]
    return np.stack(commands, axis=1) * _PWM_PER_DEGREE + _PWM_TRIM


def _times(record: FlightRecord, stream: int, rate_hz: float) -> Array:
    rng = np.random.default_rng([record.flight.seed, stream])
    return sample_times(rng, record.flight.duration_s, rate_hz)


def _esc(record: FlightRecord, times: Array, column: int, shape: Callable[[Array], Array]) -> Array:
    """Return one of the ESC's readings at other times, shape (n, 4)."""
    signals = [np.interp(times, a.time_s, shape(a.esc[:, column])) for a in record.actuators.values()]
    return np.stack(signals, axis=1)


TIERS: dict[str, Callable[[FlightRecord], list[Stream]]] = {
    "instrumented": _instrumented,
    "esc-signed": _esc_signed,
    "esc-info": _esc_info,
    "esc-unsigned": _esc_unsigned,
    "named": _named,
    "position": _position,
    "pwm": _pwm,
}
