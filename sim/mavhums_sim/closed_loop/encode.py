"""Encodes many messages to a ``.tlog`` at once: MAVLink 2 frames in one compiled pass.

This serves hours of flight; :func:`mavhums_sim.link.transmit` sends messages one by one over any link.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim._compiled import kernel
from mavhums_sim.closed_loop.tables import Table
from mavhums_sim.link import Link

_KINDS = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}
_STAMP, _HEADER, _CRC = 8, 10, 2


def encode(tables: list[Table], seed: int, link: Link | None = None) -> bytes:
    """Return the ``.tlog`` of all tables, sorted by the time of reception.

    Parameters
    ----------
    link
        Only its start, latency, jitter and loss are used.

    Examples
    --------
    >>> encode([Table("HEARTBEAT", np.array([1.0]), {"type": 1})], 0)[8:11].hex()
    'fd0500'
    """
    link = link or Link()
    tables = [table for table in tables if table.times.size]
    times = np.concatenate([table.times for table in tables])
    rng = np.random.default_rng([seed, 3])
    delays = link.latency_s + rng.exponential(link.jitter_s or 1e-9, times.size)
    sent = np.argsort(times, kind="stable")
    stamps = link.start_us + np.rint((times + delays) * 1e6).astype(np.int64)
    stamps[sent] = np.maximum.accumulate(stamps[sent])
    kept = sent[rng.random(sent.size) >= link.loss]
    payloads = [table.rows().view(np.uint8).reshape(table.times.size, -1) for table in tables]
    counts = [table.times.size for table in tables]
    lengths = np.repeat([payload.shape[1] for payload in payloads], counts)
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    identities = np.repeat([_KINDS[table.name].id for table in tables], counts)
    extras = np.repeat([_KINDS[table.name].crc_extra for table in tables], counts)
    stream = np.concatenate([payload.ravel() for payload in payloads])
    out = np.empty(int(lengths.sum()) + times.size * (_STAMP + _HEADER + _CRC), dtype=np.uint8)
    used = _frames(stream, starts, lengths, identities, extras, stamps, kept, out)
    return out[:used].tobytes()


@kernel
def _frames(
    stream: NDArray[np.uint8],
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    identities: NDArray[np.int64],
    extras: NDArray[np.int64],
    stamps: NDArray[np.int64],
    kept: NDArray[np.int64],
    out: NDArray[np.uint8],
) -> int:
    at = 0
    for order in range(kept.size):
        k = kept[order]
        for byte in range(_STAMP):
            out[at + byte] = (stamps[k] >> (8 * (7 - byte))) & 0xFF
        at += _STAMP
        length = lengths[k]
        while length > 1 and stream[starts[k] + length - 1] == 0:
            length -= 1
        head = (0xFD, length, 0, 0, order & 0xFF, 1, 1)
        for byte in range(7):
            out[at + byte] = head[byte]
        for byte in range(3):
            out[at + 7 + byte] = (identities[k] >> (8 * byte)) & 0xFF
        out[at + _HEADER : at + _HEADER + length] = stream[starts[k] : starts[k] + length]
        crc = 0xFFFF
        for byte in range(1, _HEADER + length):
            crc = _accumulate(crc, out[at + byte])
        crc = _accumulate(crc, extras[k])
        at += _HEADER + length
        out[at], out[at + 1] = crc & 0xFF, crc >> 8
        at += _CRC
    return at


@kernel
def _accumulate(crc: int, byte: int) -> int:
    """Return the X.25 checksum after one more byte."""
    mixed = (byte ^ crc) & 0xFF
    mixed = (mixed ^ (mixed << 4)) & 0xFF
    return (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
