"""What a link does to a recording: other times of reception, and another order of arrival."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

_MAVLINK2 = 0xFD
_SIGNED = 1


@dataclass(frozen=True)
class Mishap:
    """What happens between sender and receiver.

    Attributes
    ----------
    latency_s
        Constant delay by message number; 0 for the others.
    jitter_s
        Greatest delay of single messages; each type keeps its own order.
    backlog_s
        All that was sent in this time from the start arrives at its end, in one burst.
    rate
        Seconds of the receiver's clock per second of the sender's.
    """

    latency_s: Mapping[int, float] = field(default_factory=dict)
    jitter_s: float = 0.0
    backlog_s: float = 0.0
    rate: float = 1.0
    seed: int = 0


def records(tlog: bytes) -> list[tuple[int, int, bytes]]:
    """Return time of reception in microseconds, message number, and frame of each record."""
    found, at = [], 0
    while at < len(tlog):
        frame = tlog[at + 8 :]
        if frame[0] == _MAVLINK2:
            size = 12 + frame[1] + (13 if frame[2] & _SIGNED else 0)
            number = int.from_bytes(frame[7:10], "little")
        else:
            size, number = 8 + frame[1], frame[5]
        found.append((int.from_bytes(tlog[at : at + 8], "big"), number, frame[:size]))
        at += 8 + size
    return found


def rewritten(flight: list[tuple[int, int, bytes]], mishap: Mishap) -> bytes:
    """Return the flight's ``.tlog`` as a link with this mishap would have left it."""
    rng = np.random.default_rng(mishap.seed)
    begin = flight[0][0]
    newest: defaultdict[int, float] = defaultdict(float)
    arrived = []
    for k, (sent_us, number, frame) in enumerate(flight):
        delay_s = mishap.latency_s.get(number, 0.0) + mishap.jitter_s * rng.random()
        at_s = max((sent_us - begin) / 1e6 + delay_s, mishap.backlog_s, newest[number])
        newest[number] = at_s
        arrived.append((at_s, k, frame))
    return b"".join(
        (begin + round(at_s * mishap.rate * 1e6)).to_bytes(8, "big") + frame
        for at_s, _, frame in sorted(arrived)
    )
