"""Compiles every inner loop before the first log, by judging short synthetic flights, one a format."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from mavhums.actuator.freshness import Freshness
from mavhums.actuator.profile import load_airframe
from mavhums.core import startup
from mavhums.engine.engine import Engine
from mavhums.engine.options import EngineOptions
from mavhums.health.axis.regressions import Lag
from mavhums.health.axis.residuals import AttitudeResponse
from mavhums.health.motor.evidence import COLUMNS, follow, new_state, rules_for
from mavhums.health.motor.hypotheses import hypotheses_of
from mavhums.learn import packaged_models
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.stamping import Piece, Stamper

_RATE_HZ = 20
_DURATION_S = 25
_CODES = str.maketrans({"Q": "Q", "n": "4s", "N": "16s", "Z": "64s"})  # field types, as struct has them
_START_US = 1_700_000_000_000_000


def warm_up() -> int:
    """Judge synthetic flights, one a format and one as a link, and return the number of loops compiled.

    The compiled loops are kept on disk, beside the installation or in the user's cache; NUMBA_CACHE_DIR sets
    another folder.
    """
    compiled = 0

    def count() -> None:
        nonlocal compiled
        compiled += 1

    startup.on_compile(count)
    stamper = Stamper(load_dialect())
    engine = Engine(EngineOptions(load_airframe("paper"), packaged_models()))
    for time_us, frame in _frames():
        engine.feed(struct.pack(">Q", time_us) + frame)
        if time_us < _START_US + 1_000_000:
            stamper.feed([Piece("one", time_us, frame), Piece("other", time_us, frame)])
    engine.finish()
    engine.assessment()
    for log in (_dataflash(), _ulog()):
        on_board = Engine(EngineOptions())
        on_board.feed(log)
        on_board.finish()
    compile_rare_loops()
    return compiled


def compile_rare_loops() -> None:
    """Compile what no flight of 25 s with sound telemetry needs."""
    rates = np.zeros(_RATE_HZ)
    Lag(1.0).feed(rates)
    AttitudeResponse(1.0).feed(rates)
    Freshness(1.0).reasons()
    motors, still = np.zeros((1, 4)), np.zeros(1, dtype=bool)
    follow(
        motors, np.zeros((1, 3)), np.ones(1), np.ones(1), still, np.ones(1),
        np.zeros((4, 3)), rules_for(1.0), hypotheses_of(4), new_state(4), np.zeros((1, COLUMNS)),
    )  # fmt: skip


def _dataflash() -> bytes:
    """Return a .BIN: the definitions of two messages and some records of the second."""

    def definition(number: int, name: bytes, kinds: bytes, columns: bytes) -> bytes:
        size = 3 + struct.calcsize("<" + kinds.decode().translate(_CODES))
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, size, name, kinds, columns)

    records = [
        struct.pack("<BBBQHH", 0xA3, 0x95, 1, 1_000_000 + 100_000 * k, 1500, 1500) for k in range(_RATE_HZ)
    ]
    head = definition(128, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    return b"".join([head, definition(1, b"RCOU", b"QHH", b"TimeUS,C1,C2"), *records])


def _ulog() -> bytes:
    """Return a .ulg: the format of one topic, its subscription and some records."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<Hc", len(body), kind) + body

    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
    form = message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    records = [
        message(b"D", struct.pack("<HQ4f", 0, 1_000_000 + 100_000 * k, 1.0, 0.0, 0.0, 0.0))
        for k in range(_RATE_HZ)
    ]
    return b"".join([head, form, message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_attitude"), *records])


def _frames() -> Iterator[tuple[int, bytes]]:
    """Yield time and frame of a flight with two oscillating actuators, each reported in its own way."""
    from pymavlink.dialects.v20 import ardupilotmega as v2

    link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    for k in range(_RATE_HZ * _DURATION_S):
        time_s = k / _RATE_HZ
        for message in _messages(v2, time_s):
            yield _START_US + round(time_s * 1e6), bytes(message.pack(link))


def _messages(v2: Any, time_s: float) -> Iterator[Any]:
    angle_deg, speed_rpm = 20 * math.sin(time_s), 1000 * math.cos(time_s)
    stamp_us = round(time_s * 1e6) + 1_000_000
    # A current that only repeats itself would be no evidence, and nothing judged.
    amps = math.copysign(0.1, speed_rpm) + 0.03 * math.sin(7 * time_s)
    volts = 22.6 * amps + 0.00153 * speed_rpm
    load, torque = 0.1 * math.sin(2 * time_s), 0.0146 * amps
    quantities = [angle_deg, 300 * angle_deg, angle_deg, volts, amps, volts * amps, speed_rpm, torque]
    quantities += [torque * speed_rpm / 9.55, speed_rpm / 300, load, load * speed_rpm / 2865]
    yield v2.MAVLink_debug_float_array_message(stamp_us, b"EMA", 1, quantities + [0.0] * 46)
    pulse = round(1500 + angle_deg * 500 / 60)
    yield v2.MAVLink_servo_output_raw_message(stamp_us % 2**32, 0, *[pulse] * 16)
    tenths = [round(abs(value) * 100) for value in (volts, amps)]
    none, rpm = [0] * 4, round(abs(speed_rpm))
    batch = [[0] * 4, [0, tenths[0], 0, 0], [0, tenths[1], 0, 0], none, [0, rpm, 0, 0], none]
    yield v2.MAVLink_esc_telemetry_1_to_4_message(*batch)
