"""Seeded records of every message of the dialect."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from fastcrc import crc16

from mavhums.log.mavlink.dialect import MessageDefinition, load_dialect
from tests.strategies import START_US


def frame(rng: np.random.Generator, definition: MessageDefinition, sequence: int) -> bytes:
    """A frame of random content: MAVLink 1 or 2, truncated as the protocol wants, signed or not."""
    payload = rng.integers(0, 256, definition.wire.itemsize, dtype=np.uint8)
    payload[rng.integers(0, payload.size + 1) :] = 0
    if definition.id < 256 and rng.random() < 0.3:
        body = payload.tobytes()[: definition.base_size]
        head = bytes([len(body), sequence, 1, 1, definition.id])
        return b"\xfe" + sealed(head + body, definition.crc_extra)
    body = payload.tobytes().rstrip(b"\0") or b"\0"
    signed = rng.random() < 0.3
    head = bytes([len(body), signed, 0, sequence, 1, 1]) + definition.id.to_bytes(3, "little")
    return b"\xfd" + sealed(head + body, definition.crc_extra) + (rng.bytes(13) if signed else b"")


def sealed(covered: bytes, seed: int) -> bytes:
    """``covered`` and its CRC."""
    return covered + crc16.mcrf4xx(covered + bytes([seed])).to_bytes(2, "little")


def stream(seed: int, count: int) -> list[bytes]:
    """Records of one sender in order of time, one in fifty of an unknown message."""
    rng = np.random.default_rng(seed)
    definitions = list(load_dialect().definitions.values())
    out = []
    for k in range(count):
        if rng.random() < 0.02:
            head = bytes([5, 0, 0, k % 256, 1, 1]) + (60_000).to_bytes(3, "little")
            made = b"\xfd" + sealed(head + rng.bytes(5), 42)
        else:
            made = frame(rng, definitions[rng.integers(len(definitions))], k % 256)
        out.append(struct.pack(">Q", START_US + 10_000 * k) + made)
    return out


def mutated(rng: Any, record: bytes, definition_seeds: dict[int, int]) -> bytes:
    """A record with one to three bytes changed, cut or added, its CRC mostly made good again."""
    out = bytearray(record)
    for _ in range(rng.randint(1, 3)):
        place = rng.choice((8, 9, 10, 11, 15, 16, 17)) if rng.random() < 0.4 else rng.randrange(len(out))
        place = min(place, len(out) - 1)
        way = rng.random()
        if way < 0.7:
            out[place] = rng.choice((0, 1, 2, 0x0A, 0x7F, 0xFD, 0xFE, 0xFF, rng.randrange(256)))
        elif way < 0.85 and len(out) > 20:
            del out[place : place + rng.randint(1, 5)]
        else:
            out[place:place] = rng.randbytes(rng.randint(1, 5))
    if rng.random() < 0.8:
        _repair(out, definition_seeds)
    return bytes(out)


def _repair(record: bytearray, seeds: dict[int, int]) -> None:
    if len(record) < 18 or record[8] not in (0xFD, 0xFE):
        return
    head = 10 if record[8] == 0xFD else 6
    number = int.from_bytes(record[15:18], "little") if head == 10 else record[13]
    place = 8 + head + record[9]
    if place + 2 <= len(record):
        seed = seeds.get(number, 42)
        record[place : place + 2] = crc16.mcrf4xx(bytes(record[9:place]) + bytes([seed])).to_bytes(
            2, "little"
        )
