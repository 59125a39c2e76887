"""A flight whose outputs are wired in a known way, as each autopilot would log it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as v2

from tests.health.axis.flights import excited
from tests.log.dataflash import synthetic
from tests.log.ulog import writer

Array = NDArray[np.float64]

START_US = 1_700_000_000_000_000
PLANE = {"SERVO1_FUNCTION": 4.0, "SERVO2_FUNCTION": 19.0, "SERVO3_FUNCTION": 70.0, "SERVO4_FUNCTION": 21.0}
"""ArduPlane's usual outputs: aileron, elevator, throttle, rudder."""
PX4_PLANE = {
    **{f"PWM_MAIN_FUNC{n}": 200 + n for n in (1, 2, 4)},
    "PWM_MAIN_FUNC3": 101,
    "CA_SV_CS0_TYPE": 15,
    "CA_SV_CS1_TYPE": 3,
    "CA_SV_CS3_TYPE": 4,
}
_RATE_HZ = 10
_SPEED = 18.0


@dataclass(frozen=True)
class Wired:
    """A sound aircraft: its roll rate answers to servo 1; servo 2 trims it for another speed after 100 s.

    ``left`` is the part of the aileron's effect that it keeps from ``lost_s`` on, ``sent_s`` when
    the parameters are sent, ``named_s`` when the texts are, and ``coordinated_s`` until when servo 4 goes
    with servo 1; ``others`` are the pulses of servos 5 to 8, in MAVLink alone. The MAVLink vehicle of this
    ``kind`` begins its flight ``day`` days later.
    """

    seconds: int = 170
    parameters: Mapping[str, float] = field(default_factory=lambda: PLANE)
    sent_s: float = 0.0
    left: float = 1.0
    lost_s: int = 110
    coordinated_s: float = 0.0
    seed: int = 1
    texts: tuple[bytes, ...] = ()
    named_s: float = 0.0
    others: Callable[[float], Sequence[int]] = lambda t: (0, 0, 0, 0)
    kind: int = 1
    armed: bool = True
    speed: float = 18.0
    day: int = 0

    def rows(self) -> Iterator[tuple[float, list[int], float]]:
        """Yield times, pulses of servos 1 to 4, and roll rates, rad/s."""
        aileron = excited(self.seconds, seed=self.seed)[::2]
        elevator = excited(self.seconds, seed=self.seed + 7, size=0.05)[::2]
        time_s = np.arange(aileron.size) / _RATE_HZ
        elevator = elevator + np.where(time_s > 100, 0.6, 0.0)
        gain = 2.2 * np.where(time_s < self.lost_s, 1.0, self.left)
        rate = np.concatenate([np.zeros(2), (gain * aileron)[:-2]])
        rate += 0.02 * np.random.default_rng(self.seed + 2).normal(size=rate.size)
        rudder = np.where(time_s < self.coordinated_s, aileron, 0.3 + 0.05 * np.sin(time_s))
        rudder = rudder if self.coordinated_s else 0.0 * aileron
        columns = (time_s, aileron, elevator, rudder, rate)
        for t, a, e, r, p in zip(*(column.tolist() for column in columns), strict=True):
            yield t, [round(1500 + 400 * a), round(1500 + 400 * e), 1600, round(1500 + 400 * r)], p

    def tlog(self) -> bytes:
        link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
        sent: list[tuple[float, Any]] = []
        for k, (name, value) in enumerate(self.parameters.items()):
            message = v2.MAVLink_param_value_message(name.encode(), value, 9, 9, k)
            sent.append((self.sent_s + 0.01 * k, message))
        sent += [(self.named_s, v2.MAVLink_statustext_message(6, text)) for text in self.texts]
        for t, pulses, p in self.rows():
            ms, us = round(t * 1e3), round(t * 1e6)
            if round(t * _RATE_HZ) % _RATE_HZ == 0:
                sent.append((t, v2.MAVLink_heartbeat_message(self.kind, 3, 128 * self.armed, 10, 4, 3)))
            sent += [
                (t, v2.MAVLink_servo_output_raw_message(us, 0, *pulses, *self.others(t))),
                (t, v2.MAVLink_raw_imu_message(us, 0, 0, -1000, round(1000 * p), 0, 0, 0, 0, 0)),
                (t, v2.MAVLink_attitude_message(ms, 0.0, 0.0, 0.0, p, 0.0, 0.0)),
                (t, v2.MAVLink_vfr_hud_message(self.speed, self.speed, 0, 50, 100.0, 0.0)),
            ]
        sent.sort(key=lambda one: one[0])
        start_us = START_US + self.day * 86_400_000_000
        return b"".join(
            struct.pack(">Q", start_us + round(t * 1e6)) + bytes(message.pack(link)) for t, message in sent
        )

    def dataflash(self) -> bytes:
        formats = {
            "PARM": (4, "QNf", "TimeUS,Name,Value"),
            "MSG": (5, "QZ", "TimeUS,Message"),
            "RCOU": (9, "QHHHH", "TimeUS,C1,C2,C3,C4"),
            "IMU": (10, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
            "ATT": (11, "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
            "ARSP": (12, "QBf", "TimeUS,I,Airspeed"),
            "GPS": (13, "QBBIHff", "TimeUS,I,Status,GMS,GWk,Spd,GCrs"),
            "STAT": (14, "QBfB", "TimeUS,isFlying,isFlyProb,Armed"),
            "MODE": (15, "QBBB", "TimeUS,Mode,ModeNum,Rsn"),
        }
        out = [synthetic.fmt_of_fmt()]
        out += [synthetic.definition(number, name, *rest) for name, (number, *rest) in formats.items()]

        def put(name: str, t: float, *values: Any) -> None:
            number, letters, _ = formats[name]
            out.append(synthetic.record(number, letters, [1_000_000 + round(t * 1e6), *values]))

        put("MSG", 0.0, b"ArduPlane V4.5.7 (0fe2a2b6)")
        put("MODE", 0.0, 10, 10, 1)
        unsent = dict(self.parameters)
        for t, pulses, p in self.rows():
            while unsent and t >= self.sent_s:
                name = next(iter(unsent))
                put("PARM", t, name.encode(), unsent.pop(name))
            if round(t * _RATE_HZ) % _RATE_HZ == 0:
                put("STAT", t, 1, 1.0, 1)
                put("GPS", t, 0, 3, round(1000 * t), 2300, _SPEED, 0.0)
            put("RCOU", t, *pulses)
            put("IMU", t, 0, p, 0.0, 0.0, 0.0, 0.0, -9.81)
            put("ATT", t, 0, 0, 0, 0, 0, 0)
            put("ARSP", t, 0, _SPEED)
        return b"".join(out)

    def ulog(self) -> bytes:
        topics = {
            "actuator_outputs": "uint64_t timestamp;uint32_t noutputs;float[16] output;uint8_t[4] _padding0;",
            "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
            "vehicle_attitude": "uint64_t timestamp;float[4] q;",
            "airspeed": "uint64_t timestamp;float indicated_airspeed_m_s;uint8_t[4] _padding0;",
            "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t system_type;"
            "uint8_t nav_state;uint8_t[5] _padding0;",
            "vehicle_local_position": "uint64_t timestamp;float vx;float vy;float z;uint8_t[4] _padding0;",
        }
        out = [writer.header(), *(writer.form(name, fields) for name, fields in topics.items())]
        unsent = [writer.parameter(name, value) for name, value in self.parameters.items()]
        out += [writer.keyed("I", "char[3] sys_name", b"PX4"), writer.parameter("MAV_SYS_ID", 1)]
        out += [unsent.pop(0) for _ in self.parameters] if self.sent_s == 0 else []
        out += [writer.subscribe(number, name) for number, name in enumerate(topics)]
        for t, pulses, p in self.rows():
            now = 1_000_000 + round(t * 1e6)
            out += [unsent.pop(0) for _ in self.parameters] if unsent and t >= self.sent_s else []
            out.append(writer.data(0, struct.pack("<QI16f4x", now, 4, *pulses, *[0.0] * 12)))
            out.append(writer.data(1, struct.pack("<Q6f", now, p, 0.0, 0.0, 0.0, 0.0, -9.81)))
            out.append(writer.data(2, struct.pack("<Q4f", now, 1.0, 0.0, 0.0, 0.0)))
            out.append(writer.data(3, struct.pack("<Qf4x", now, _SPEED)))
            if round(t * _RATE_HZ) % _RATE_HZ == 0:
                out.append(writer.data(4, struct.pack("<Q3B5x", now, 2, 1, 3)))
                out.append(writer.data(5, struct.pack("<Q3f4x", now, _SPEED, 0.0, -50.0)))
        return b"".join(out)
