"""The radio link and the sender's clock: delay, loss and reordering between aircraft and log."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from pymavlink.dialects.v10 import ardupilotmega as mavlink1
from pymavlink.dialects.v20 import ardupilotmega as mavlink2

EPOCH_US = 1_767_258_000_000_000  # 2026-01-01 09:00:00 UTC
LAST_DAY = 36_525  # flights begin within a hundred years
BOOT_US = 30_000_000  # the vehicle has run for half a minute when the log starts
_SIGNING_EPOCH_US = 1_420_070_400_000_000  # 2015-01-01, where MAVLink 2 signatures count from
_MAX_LINKS = 4
_CLOCKS = {"time_usec": 1.0, "time_boot_ms": 1e-3}
_BITS = {  # of the clocks that are narrower than 64 bits
    (message.msgname, name): 32
    for message in mavlink2.mavlink_map.values()
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True)
    if name in _CLOCKS and kind == "uint32_t"
}

Message = Any


@dataclass(frozen=True, slots=True)
class Link:
    """A link from the aircraft to the log; the default loses and reorders nothing.

    Attributes
    ----------
    latency_s, jitter_s
        Minimum delay, and the mean of an additional exponential delay. The order is kept.
    loss, burst
        Fraction of frames lost, and mean number lost in a row (Gilbert's two-state channel).
    late, late_s
        Fraction of frames delayed, and mean delay; other frames overtake them.
    links
        Number of parallel links, 1…4; each carries every frame, with independent loss. As in MAVProxy,
        the low two bits of the time stamp are the number of the link.
    clock_offset_s, clock_drift_ppm
        Error of the sender's clock at the start, and its growth.
    reboot_at_s, outage_s
        The vehicle restarts: silent for the outage, then its clock and sequence start from zero.
    mavlink
        Protocol version; version 1 drops ids above 255 and extension fields.
    key
        Signing key for every frame, 32 bytes (MAVLink 2 only).
    day
        Start of the flight, days after 2026-01-01 09:00 UTC, to simulate a history.
    baud
        Bits a second of the serial line to the radio, ten to a byte; the aircraft thins its streams to
        that. None carries everything.

    Raises
    ------
    ValueError
        If a number is out of range, or MAVLink 1 is to be signed.
    """

    latency_s: float = 0.002
    jitter_s: float = 0.001
    loss: float = 0.0
    burst: float = 1.0
    late: float = 0.0
    late_s: float = 0.1
    links: int = 1
    clock_offset_s: float = 0.0
    clock_drift_ppm: float = 0.0
    reboot_at_s: float | None = None
    outage_s: float = 3.0
    mavlink: Literal[1, 2] = 2
    key: bytes | None = None
    day: float = 0.0
    baud: float | None = None

    @property
    def start_us(self) -> int:
        """Start of the flight, microseconds of UTC."""
        return EPOCH_US + round(self.day * 86_400e6)

    def __post_init__(self) -> None:
        if not (0.0 <= self.loss < 1.0 and 0.0 <= self.late < 1.0):
            raise ValueError("loss and late are shares of the frames, from 0 to below 1")
        if self.burst < max(1.0, self.loss / (1.0 - self.loss)):
            raise ValueError("burst is a mean number of frames lost in a row, at least 1 and loss/(1 − loss)")
        if min(self.latency_s, self.jitter_s, self.late_s, self.outage_s, self.reboot_at_s or 0.0) < 0.0:
            raise ValueError("times of a link cannot be negative")
        if not 1 <= self.links <= _MAX_LINKS:
            raise ValueError(f"there can be 1…{_MAX_LINKS} links")
        if not 0.0 <= self.day <= LAST_DAY:
            raise ValueError("a flight begins between day 0 and a hundred years later")
        if self.baud is not None and not self.baud > 0.0:
            raise ValueError("baud is a number of bits a second, above 0")
        if self.mavlink not in (1, 2):
            raise ValueError("MAVLink has versions 1 and 2")
        if self.key is not None and (self.mavlink == 1 or len(self.key) != 32):
            raise ValueError("a signing key has 32 bytes, and needs MAVLink 2")


class Frame(NamedTuple):
    """A frame as received: microseconds of UTC, its bytes, its message's name."""

    received_us: int
    data: bytes
    name: str


def transmit(stream: Iterable[tuple[float, Message]], link: Link, seed: int) -> Iterator[Frame]:
    """Yield the frames of a stream of (flight time in s, message), in order of reception.

    Only the frames in transit are buffered.
    """
    sender = _Sender(link)
    channels = [_Channel(link, seed, number) for number in range(link.links)]
    under_way: list[tuple[int, int, Frame]] = []
    sent = 0
    for time_s, message in stream:
        frame = sender.send(time_s, message)
        if frame is None:
            continue
        for channel in channels:
            received_us = channel.receive(time_s)
            if received_us is not None:
                sent += 1
                heapq.heappush(under_way, (received_us, sent, Frame(received_us, *frame)))
        earliest = link.start_us + round((time_s + link.latency_s) * 1e6) - _MAX_LINKS
        while under_way and under_way[0][0] < earliest:
            yield heapq.heappop(under_way)[2]
    while under_way:
        yield heapq.heappop(under_way)[2]


def frame_size(link: Link, message: Message) -> int:
    """Return the bytes of a message over a link; 0 if its protocol has no such message."""
    sent = _Sender(replace(link, reboot_at_s=None)).send(0.0, message)
    return len(sent[0]) if sent else 0


class _Sender:
    """The sender: clock, sequence numbers, protocol version and signature."""

    def __init__(self, link: Link) -> None:
        self._link = link
        dialect = mavlink1 if link.mavlink == 1 else mavlink2
        self._mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self._rebooted = False
        if link.key is not None:
            self._mav.signing.secret_key = link.key
            self._mav.signing.sign_outgoing = True

    def send(self, time_s: float, message: Message) -> tuple[bytes, str] | None:
        """Return the frame and its message's name; None if it is not sent."""
        link = self._link
        shift_s = link.clock_offset_s + link.clock_drift_ppm * 1e-6 * time_s
        if link.reboot_at_s is not None and time_s >= link.reboot_at_s:
            back_s = link.reboot_at_s + link.outage_s
            if time_s < back_s:
                return None
            shift_s -= BOOT_US / 1e6 + back_s
            if not self._rebooted:
                self._rebooted, self._mav.seq = True, 0
        if shift_s:
            _shift_clock(message, shift_s)
        if link.mavlink == 1:
            message = _as_mavlink1(message)
            if message is None:
                return None
        if link.key is not None:
            now = (link.start_us + round(time_s * 1e6) - _SIGNING_EPOCH_US) // 10
            self._mav.signing.timestamp = max(self._mav.signing.timestamp, now)
        data: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return data, message.get_type()


def _shift_clock(message: Message, shift_s: float) -> None:
    for name, per_us in _CLOCKS.items():
        if name in message.fieldnames:
            shifted = getattr(message, name) + round(shift_s * 1e6 * per_us)
            setattr(message, name, max(shifted, 0) % 2 ** _BITS.get((message.get_type(), name), 64))


def _as_mavlink1(message: Message) -> Message | None:
    """Return the message without its extensions, or None if MAVLink 1 has no such message."""
    kind = mavlink1.mavlink_map.get(message.get_msgId())
    if kind is None:
        return None
    return kind(*(getattr(message, f"_{name}_raw", getattr(message, name)) for name in kind.fieldnames))


class _Channel:
    """One of the parallel links: delay, loss, lateness."""

    def __init__(self, link: Link, seed: int, number: int) -> None:
        self._link, self._number = link, number
        self._delay = np.random.default_rng([seed, 3] if number == 0 else [seed, 3, number])
        self._fate = np.random.default_rng([seed, 8, number])
        self._last_us = 0
        self._fading = False

    def receive(self, time_s: float) -> int | None:
        """Return the time of reception of a frame sent now, µs of UTC; None if it is lost."""
        link = self._link
        delay_us = link.latency_s * 1e6 + self._delay.exponential(link.jitter_s * 1e6)
        arrival_us = link.start_us + round(time_s * 1e6 + delay_us)
        if link.loss and self._fades():
            return None
        if link.late and self._fate.random() < link.late:
            held_us = arrival_us + round(self._fate.uniform(0.5, 1.5) * link.late_s * 1e6)
            return self._stamp(held_us)
        self._last_us = max(self._last_us, arrival_us)
        return self._stamp(self._last_us)

    def _stamp(self, received_us: int) -> int:
        return received_us if self._link.links == 1 else received_us // _MAX_LINKS * _MAX_LINKS + self._number

    def _fades(self) -> bool:
        """Step Gilbert's channel: stay in loss with 1 − 1/burst; enter it to give the mean loss."""
        link = self._link
        begin = link.loss / (link.burst * (1.0 - link.loss))
        self._fading = self._fate.random() < (1.0 - 1.0 / link.burst if self._fading else begin)
        return self._fading
