"""Write ULogs, message by message; nothing here is shared with the decoder."""

from __future__ import annotations

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
    parts += [
        keyed("I", "char[3] sys_name", b"PX4"),
        parameter("MAV_SYS_ID", vehicle),
        parameter("PWM_MAIN_MIN1", 1000),
        parameter("CA_SV0_TRQ_R", -0.5),
    ]
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
