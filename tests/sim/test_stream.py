"""The live flight: when frames are sent, and that they arrive."""

from __future__ import annotations

import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim import Flight, fly
from mavhums_sim.link import Frame, Link, transmit
from mavhums_sim.stream import connect, stream
from mavhums_sim.telemetry import messages


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_frames_are_sent_when_they_are_due(speed: float) -> None:
    slept: list[float] = []  # nothing else moves the clock
    sent: list[tuple[float, bytes]] = []
    frames = [Frame(5_000_000 + k * 250_000, bytes([k]), "HEARTBEAT") for k in (0, 1, 1, 6)]
    clock = {"clock": lambda: 100.0 + sum(slept), "sleep": slept.append}
    counts = stream(frames, lambda data: sent.append((sum(slept), data)), speed, **clock)  # type: ignore[arg-type]
    assert all(seconds > 0 for seconds in slept)
    assert [data for _, data in sent] == [b"\0", b"\1", b"\1", b"\6"]
    assert [at for at, _ in sent] == pytest.approx([0.0, 0.25 / speed, 0.25 / speed, 1.5 / speed])
    assert counts == {"HEARTBEAT": 4}


def test_every_frame_arrives_over_udp() -> None:
    record = fly(Flight(duration_s=2.0, rate_hz=10.0))
    frames = list(transmit(messages(record), Link(), 0))
    receiver = mavlink.MAVLink(None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(60.0)
        with connect(f"udpout:127.0.0.1:{ground.getsockname()[1]}") as write:
            counts = stream(frames, write, speed=50.0)
        received = [ground.recv(512) for _ in frames]
    assert received == [frame.data for frame in frames]
    assert sum(counts.values()) == len(frames)
    assert receiver.parse_buffer(bytearray(b"".join(received)))


@pytest.mark.parametrize("url", ["127.0.0.1:14550", "udpout:127.0.0.1", "file:log.tlog", "udpout::14550"])
def test_addresses_of_another_form_are_refused(url: str) -> None:
    with pytest.raises(ValueError, match="is not udpout:HOST:PORT"), connect(url):
        pass
