"""Mutated ULogs, decoded whole and in blocks: no crash, no hang, the same from either."""

from __future__ import annotations

import random
import struct

from tests.log.decode import assert_cuts_do_not_matter
from tests.log.ulog import writer

PER_STREAM = 200
KINDS = b"ABCDFILMOPQRSZ\0"


def messages_of(log: bytes) -> list[bytes]:
    """Cut a sound log behind its header into its messages."""
    out, place = [], 16
    while place < len(log):
        end = place + 3 + int.from_bytes(log[place : place + 2], "little")
        out.append(log[place:end])
        place = end
    return out


def mutated(rng: random.Random, message: bytes, pool: list[bytes]) -> bytes:
    """Return a message with one thing wrong, or what should not be in its place."""
    out = bytearray(message)
    match rng.randrange(11):
        case 0:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
        case 1:
            out[2] = rng.choice(KINDS)
        case 2:
            struct.pack_into("<H", out, 0, rng.choice((0, 1, 2, len(out), 65535, rng.randrange(65536))))
        case 3:
            del out[rng.randrange(len(out)) :]
        case 4:
            del out[: rng.randrange(len(out))]
        case 5:
            out[3:] = rng.randbytes(len(out) - 3)
        case 6:
            out += rng.randbytes(rng.randrange(300))
        case 7:
            name = rng.choice(list(writer.FLIGHT))
            types = rng.choices(
                ["float", "char", "uint64_t", "esc_report", name, "what"], k=rng.randrange(1, 5)
            )
            fields = "".join(f"{kind}[{rng.choice((0, 1, 9, 65535))}] f{k};" for k, kind in enumerate(types))
            return writer.form(rng.choice([name, "new"]), fields) + bytes(out)
        case 8:
            name = rng.choice([*writer.FLIGHT, "new", "parameter", ""])
            return writer.subscribe(rng.choice((0, 1, 2, 3, 9, 65535)), name, rng.randrange(256)) + bytes(out)
        case 9:
            return writer.message("R", struct.pack("<H", rng.randrange(10))) + bytes(out)
        case _:
            return rng.choice(pool) + bytes(rng.randrange(40)) + bytes(out)
    return bytes(out)


def hostile_log(rng: random.Random, pool: list[bytes], mutations: int) -> bytes:
    """Return a log in which every second message is mutated; some have boundaries of appended data."""
    begin = rng.randrange(len(pool))
    parts = [*pool[:20]]
    for k in range(mutations):
        message = pool[(begin + k) % len(pool)]
        parts += [mutated(rng, message, pool), rng.choice(pool)]
    body = b"".join(parts)
    offsets = [rng.randrange(len(body)) for _ in range(rng.choice((0, 0, 1, 3)))]
    return writer.header(appended=offsets or None) + body


def check(mutations: int, seed: int) -> tuple[int, int]:
    """Decode that many mutations; return the number of bytes and of messages found."""
    rng = random.Random(seed)
    pool = messages_of(writer.flight(4.0))
    size = found = 0
    for done in range(0, mutations, PER_STREAM):
        log = hostile_log(rng, pool, min(PER_STREAM, mutations - done))
        decoder = assert_cuts_do_not_matter(log, sorted(rng.randrange(len(log)) for _ in range(4)))
        size += len(log)
        found += sum(decoder.counts.values())
    return size, found
