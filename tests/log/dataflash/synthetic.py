"""Made DataFlash logs: every field type."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Sequence
from typing import Any

CODES = {
    "a": "32h", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "g": "e",
    "n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q",
    "Q": "Q",
}  # fmt: skip
FORMATS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "IMU": (0, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": (1, "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "RCOU": (2, "QHHHH", "TimeUS,C1,C2,C3,C4"),
    "GPS": (3, "QBBIHLLe", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt"),
    "PARM": (4, "QNf", "TimeUS,Name,Value"),
    "MSG": (5, "QZ", "TimeUS,Message"),
    "ISBD": (6, "QHHa", "TimeUS,N,seqno,x"),
    "FILE": (7, "NIBZ", "FileName,Offset,Length,Data"),
    "DSF": (8, "QI", "TimeUS,Dp"),
}


def definition(number: int, name: str, letters: str, columns: str) -> bytes:
    """A FMT record."""
    length = 3 + sum(struct.calcsize("<" + CODES[c]) for c in letters)
    body = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
    return b"\xa3\x95\x80" + body


def fmt_of_fmt() -> bytes:
    return definition(128, "FMT", *FORMATS["FMT"][1:])


def record(number: int, letters: str, values: Sequence[Any]) -> bytes:
    """A record; an ``a`` takes 32 values."""
    flat: list[Any] = []
    for letter, value in zip(letters, values, strict=True):
        flat += list(value) if letter == "a" else [value]
    return bytes([0xA3, 0x95, number]) + struct.pack("<" + "".join(CODES[c] for c in letters), *flat)


def of(name: str, *values: object) -> bytes:
    """A record of one of the messages."""
    number, letters, _ = FORMATS[name]
    return record(number, letters, values)


def rcou(time_us: int) -> bytes:
    return of("RCOU", time_us, 1000, 1500, 1500, 2000)


def _values(rng: random.Random, letters: str, time_us: int) -> list[Any]:
    draws: dict[str, Callable[[], Any]] = {
        "Q": lambda: time_us, "f": lambda: rng.uniform(-9, 9), "n": lambda: b"ABCD",
        "N": lambda: b"SERVO1_TRIM", "Z": lambda: rng.randbytes(40), "L": lambda: rng.randint(-(9**9), 9**9),
        "a": lambda: [rng.randint(-9, 9) for _ in range(32)], "e": lambda: rng.randint(-99, 99),
        "c": lambda: rng.randint(-18000, 18000),
    }  # fmt: skip
    return [draws.get(letter, lambda: rng.randint(0, 100))() for letter in letters]


def stream(seed: int, count: int, *, start_us: int = 1_000_000) -> list[bytes]:
    """The records of a log: definitions, then that many records, 400 a second."""
    rng = random.Random(seed)
    records = [definition(n, name, letters, columns) for name, (n, letters, columns) in FORMATS.items()]
    names = [name for name in FORMATS if name != "FMT"]
    weights = [40, 20, 20, 5, 2, 1, 1, 1, 1]
    for k in range(count):
        number, letters, _ = FORMATS[rng.choices(names, weights)[0]]
        time_us = start_us + 2500 * k + rng.randint(-300, 0)
        records.append(record(number, letters, _values(rng, letters, time_us)))
    return records


def mutated(rng: random.Random, original: bytes) -> bytes:
    """One record, damaged where it hurts: head, type, length, text, time, or its size."""
    data = bytearray(original)
    kind = rng.randrange(8)
    if kind == 0:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[2] = rng.randrange(256)
    elif kind == 2:
        del data[rng.randrange(len(data)) :]
    elif kind == 3:
        data[rng.randrange(len(data))] = rng.randrange(256)
    elif kind == 4 and len(data) >= 11:
        struct.pack_into("<Q", data, 3, rng.choice([0, 2**64 - 1, 2**52, 2**63, rng.randrange(2**40)]))
    elif kind == 5:
        body = definition(
            rng.randrange(256), "X" * rng.randrange(5), "Q" + "B" * rng.randrange(15), "TimeUS,a"
        )
        data = bytearray(body)
        data[rng.randrange(len(data))] = rng.choice([0, 3, 4, 11, 255])
    elif kind == 6:
        data += bytes([rng.choice([0, 255, 0xA3])]) * rng.choice([1, 2, 8, 20, 5000])
    else:
        data = bytearray(definition(128, "FMT", *FORMATS["FMT"][1:]))
    return bytes(data)
