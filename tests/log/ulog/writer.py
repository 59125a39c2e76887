"""Write ULogs, message by message; nothing here is shared with the decoder."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

MAGIC = b"ULog\x01\x12\x35"
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
FLIGHT = {
    "vehicle_gps_position": "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;uint8_t fix_type;",
    "vehicle_attitude": "uint64_t timestamp;float[4] q;uint8_t[4] _padding0;",
    "actuator_outputs": "uint64_t timestamp;uint32_t noutputs;float[16] output;uint8_t[4] _padding0;",
    "esc_report": "uint64_t timestamp;int32_t esc_rpm;float esc_voltage;float esc_current;",
    "esc_status": "uint64_t timestamp;uint8_t esc_count;uint8_t[7] _padding0;esc_report[8] esc;",
}
"""Formats of some topics, as PX4 has them."""


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def header(
    start_us: int = 1_000_000, *, appended: Sequence[int] | None = None, incompatible: int = 0
) -> bytes:
    head = MAGIC + b"\x01" + struct.pack("<Q", start_us)
    if appended is None and not incompatible:
        return head
    offsets = [*(appended or ()), 0, 0, 0][:3]
    flags = bytes(8) + bytes([bool(appended) | incompatible]) + bytes(7) + struct.pack("<3Q", *offsets)
    return head + message("B", flags)


def form(name: str, fields: str) -> bytes:
    return message("F", f"{name}:{fields}".encode())


def subscribe(number: int, name: str, instance: int = 0) -> bytes:
    return message("A", struct.pack("<BH", instance, number) + name.encode())


def data(number: int, record: bytes) -> bytes:
    return message("D", struct.pack("<H", number) + record)


def keyed(kind: str, key: str, value: bytes) -> bytes:
    return message(kind, bytes([len(key)]) + key.encode() + value)


def parameter(name: str, value: float) -> bytes:
    if isinstance(value, int):
        return keyed("P", f"int32_t {name}", struct.pack("<i", value))
    return keyed("P", f"float {name}", struct.pack("<f", value))


def text(said: str, time_us: int, level: int = 6, tag: int | None = None) -> bytes:
    if tag is None:
        return message("L", struct.pack("<BQ", 48 + level, time_us) + said.encode())
    return message("C", struct.pack("<BHQ", 48 + level, tag, time_us) + said.encode())


def dropout(duration_ms: int) -> bytes:
    return message("O", struct.pack("<H", duration_ms))


def sync() -> bytes:
    return message("S", SYNC)


def flight(
    seconds: float = 10.0, *, start_us: int = 5_000_000, fix_from: int | None = 3, vehicle: int = 7
) -> bytes:
    """A short flight: attitude at 50 Hz, outputs and ESCs at 10 Hz, a fix, texts, a dropout and syncs."""
    parts = [header(start_us), *(form(name, fields) for name, fields in FLIGHT.items())]
    values = {"MAV_SYS_ID": vehicle, "PWM_MAIN_MIN1": 1000, "CA_SV0_TRQ_R": -0.5}
    parts += [keyed("I", "char[3] sys_name", b"PX4"), *(parameter(*one) for one in values.items())]
    names = ["vehicle_attitude", "actuator_outputs", "esc_status", "vehicle_gps_position"]
    parts += [subscribe(number, name) for number, name in enumerate(names)]
    parts += [subscribe(9, "actuator_outputs", 1)]
    for k in range(int(seconds * 50)):
        now = start_us + 20_000 * k
        parts.append(data(0, struct.pack("<Q4f", now, 1.0, k / 100, 0.0, 0.0)))
        if k % 5 == 0:
            pulses = [1500.0 + 100 * (k % 3), *[900.0] * 15]
            parts += [data(n, struct.pack("<QI16f", now, 4, *pulses)) for n in (1, 9)]
            escs = b"".join(struct.pack("<Qiff", now, 100 * e + k, 24.0, 1.5 * e) for e in range(8))
            parts.append(data(2, struct.pack("<QB7x", now, 8) + escs))
        if k % 25 == 0:
            fix = 3 if fix_from is not None and k >= fix_from else 0
            utc = 1_700_000_000_000_000 + now
            parts += [data(3, struct.pack("<QQiB", now, utc, 473_000_000, fix)), sync()]
        if k % 100 == 50:
            parts += [text(f"text {k}", now), text("tagged", now, tag=3), dropout(20)]
            parts.append(parameter("PWM_MAIN_MIN1", 1000 + k))
    return b"".join(parts)


_CODES = {"uint64_t": "Q", "uint8_t": "B", "int32_t": "i", "float": "f", "double": "d"}
TOPICS = {
    "vehicle_status": (2, "uint8_t arming_state;uint8_t system_type;uint8_t nav_state;"),
    "vehicle_land_detected": (2, "uint8_t landed;"),
    "vtol_vehicle_status": (2, "uint8_t vehicle_vtol_state;"),
    "actuator_outputs": (25, "float[16] output;"),
    "sensor_combined": (50, "float[3] gyro_rad;float[3] accelerometer_m_s2;"),
    "vehicle_angular_velocity": (25, "float[3] xyz;"),
    "vehicle_attitude": (50, "float[4] q;float rollspeed;float pitchspeed;float yawspeed;"),
    "vehicle_attitude_setpoint": (25, "float[4] q_d;float roll_body;float pitch_body;"),
    "airspeed": (10, "float indicated_airspeed_m_s;"),
    "airspeed_validated": (10, "float indicated_airspeed_m_s;"),
    "vehicle_local_position": (10, "float vx;float vy;float vz;float z;"),
    "vehicle_global_position": (5, "double lat;double lon;float alt;"),
    "vehicle_gps_position": (2, "uint64_t time_utc_usec;uint8_t fix_type;"),
    "input_rc": (10, "float[18] values;"),
    "esc_status": (25, "esc_report[8] esc;"),
    "debug_array": (25, "uint8_t id;char[10] name;float[58] data;"),
    "debug_key_value": (10, "char[10] key;float value;"),
    "debug_vect": (2, "char[10] name;float x;"),
}
"""Rates, Hz, and fields after the stamp of the topics of :func:`flown`."""


def _sample(topic: str, name: str, width: int, k: int) -> list[float]:
    """Return what a wing that turns gently reports of a field in its k-th sample."""
    now = k / TOPICS[topic][0]
    wave = math.sin(now)
    half = [math.cos(wave / 4), math.sin(wave / 4), 0, 0]
    ema = [20 * wave, 4000 * wave, 20 * wave, 24, wave, 24, 500 * wave, 0.1, 1, 3, 0.2, 1]
    known: dict[str, list[float]] = {
        "arming_state": [2], "system_type": [1], "vehicle_vtol_state": [4], "fix_type": [3],
        "time_utc_usec": [1_700_000_000_000_000 + int(now * 1e6)], "q": half, "q_d": half,
        "indicated_airspeed_m_s": [20 + wave], "vx": [18.0], "vy": [6.0],
        "lat": [47.0 + now / 1e4], "lon": [8.5], "alt": [500.0], "accelerometer_m_s2": [0, wave, -9.81],
        "output": [1500 + 300 * math.sin(now + i) for i in range(16)], "values": [1500 + 200 * wave] * 18,
        "id": [1 + k % 4], "data": [*ema, *[0.0] * 46],
    }  # fmt: skip
    return known.get(name, [wave] * width)


def flown(seconds: float = 20.0, *, start_us: int = 5_000_000) -> bytes:
    """Return a flight of a fixed wing that has every topic that is read, with all its fields."""
    texts = {"debug_array": b"EMA", "debug_key_value": b"S1V05", "debug_vect": b"wind"}
    parts = [header(start_us), form("esc_report", FLIGHT["esc_report"])]
    parts += [form(topic, "uint64_t timestamp;" + fields) for topic, (_, fields) in TOPICS.items()]
    info = {"char[3] sys_name": b"PX4", "uint32_t ver_sw_release": b"\xff\x00\x0e\x01"}
    parts += [keyed("I", *one) for one in (info | {"char[8] sys_uuid": b"0123abcd"}).items()]
    known = {"MAV_SYS_ID": 7} | {f"CA_SV_CS{k}_TYPE": k + 1 for k in range(4)}
    known |= {f"PWM_MAIN_FUNC{k + 1}": 201 + k for k in range(4)}
    parts += [parameter(*one) for one in known.items()]
    parts += [text("a wing", start_us), text("tagged", start_us, tag=3)]
    parts += [subscribe(number, topic) for number, topic in enumerate(TOPICS)]
    records = []
    for number, (topic, (rate, fields)) in enumerate(TOPICS.items()):
        for k in range(int(seconds * rate)):
            now = start_us + k * 1_000_000 // rate
            body = struct.pack("<Q", now)
            for kind, _, name in (one.partition(" ") for one in fields.split(";")[:-1]):
                form_, _, count = kind.rstrip("]").partition("[")
                if form_ == "esc_report":
                    body += b"".join(struct.pack("<Qiff", now, 400, 24.0, 1.0) for _ in range(8))
                elif form_ == "char":
                    body += texts[topic].ljust(int(count), b"\0")
                else:
                    width = int(count or 1)
                    whole = _CODES[form_] in "QBi"
                    values = [int(v) if whole else v for v in _sample(topic, name, width, k)]
                    body += struct.pack(f"<{width}{_CODES[form_]}", *values)
            records.append((now, data(number, body)))
    return b"".join(parts) + b"".join(record for _, record in sorted(records, key=lambda one: one[0]))
