"""When a datagram came, by this computer's clock, whatever held the program up."""

from __future__ import annotations

import itertools
import os
import pty
import socket
import sys
import time
import tty
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mavhums.live.links import Address, ReceiveClock, UdpLink
from mavhums.live.streams import Outgoing, TcpLink
from mavhums.log.mavlink.stamping import Piece

SECOND = 1_000_000_000


class Clocks:
    """A wall clock that can be set, and a steady one."""

    def __init__(self) -> None:
        self.wall, self.steady = 1_700_000_000 * SECOND, 5 * SECOND
        self.clock = ReceiveClock(lambda: self.wall, lambda: self.steady)

    def go(self, nanoseconds: int) -> int:
        self.wall += nanoseconds
        self.steady += nanoseconds
        return self.wall


@example(step_s=0, at=0)
@given(step_s=st.integers(-100_000, 100_000), at=st.integers(0, 39))
def test_a_clock_that_is_set_in_a_stall_moves_nothing_much(step_s: int, at: int) -> None:
    """No time is outside the stall; without a step each is exact."""
    clocks = Clocks()
    began_us = clocks.clock.now_us()
    stamps = []
    for k in range(40):
        stamps.append(clocks.go(SECOND // 2))
        if k == at:
            clocks.wall += step_s * SECOND
    times = [time_us - began_us for time_us in clocks.clock.at_us(stamps, began_us)]
    assert all(0 <= time_us <= 20_000_000 for time_us in times)
    if step_s == 0:
        assert times == [500_000 * k for k in range(1, 41)]


def test_without_a_bound_nothing_is_older_than_a_second() -> None:
    clocks = Clocks()
    now_us = clocks.clock.now_us()
    stamps = [clocks.wall - 9 * SECOND, clocks.wall + SECOND, None]
    assert clocks.clock.at_us(stamps) == [now_us - 1_000_000, now_us, now_us]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the kernel gives no times of reception")
def test_datagrams_that_waited_are_stamped_by_the_kernel() -> None:
    link = UdpLink(Address("udpin", "127.0.0.1", 0), ReceiveClock())
    time.sleep(0.3)  # the kernel begins to stamp a little after the first socket asks for it
    assert link.receive() == []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.sendto(b"first", ("127.0.0.1", link.address.port))
        time.sleep(1.2)
        out.sendto(b"second", ("127.0.0.1", link.address.port))
    first, second = link.receive()
    link.close()
    assert second.time_us - first.time_us >= 1_190_000


def test_a_stream_that_is_not_read_gets_whole_frames_and_drops_the_rest() -> None:
    out, got = Outgoing(), bytearray()
    room = 100

    def write(data: bytes) -> int:
        nonlocal room
        if not room:
            raise BlockingIOError
        taken = min(room, len(data))
        got.extend(data[:taken])
        room -= taken
        return taken

    frames = [bytes([k % 256]) * 30 for k in range(1000)]
    for frame in frames:
        out.offer(frame)
        out.pump(write)
    assert len(got) == 100
    room = 1 << 20
    out.pump(write)
    whole = [bytes(got[k : k + 30]) for k in range(0, len(got), 30)]
    assert all(len(set(frame)) == 1 for frame in whole), "the frame that had begun was finished"
    assert len(whole) + out.dropped == 1000
    assert whole[-1] == frames[-1]
    out.refuse()
    out.offer(b"late")
    out.clear()
    assert out.dropped == 1000 - len(whole) + 2


@pytest.fixture
def deaf_server() -> Iterator[int]:
    """A TCP server that accepts and never reads."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        yield server.getsockname()[1]


def test_a_tcp_server_that_does_not_read_stops_nothing(deaf_server: int) -> None:
    link = TcpLink(Address("tcp", "127.0.0.1", deaf_server), ReceiveClock())
    for _ in range(200):
        link.receive()
        if link.fileno() >= 0:
            break
        time.sleep(0.01)
    began = time.monotonic()
    for _ in itertools.takewhile(lambda _: not link.unsent, range(100_000)):
        link.send(bytes(1000), [])
    assert link.unsent > 0
    link.close()
    assert time.monotonic() - began < 30


@pytest.mark.skipif(find_spec("serial") is None, reason="no serial port package (pip install pyserial)")
def test_a_serial_peer_that_does_not_read_stops_nothing() -> None:
    from mavhums.live.streams import SerialLink

    master, slave = pty.openpty()
    tty.setraw(master)
    link = SerialLink(Address("serial", os.ttyname(slave), 57_600), ReceiveClock())
    link.send(b"first", [])
    assert os.read(master, 5) == b"first"
    for _ in itertools.takewhile(lambda _: not link.unsent, range(10_000)):
        link.send(bytes(40), [])
    assert link.unsent > 0
    os.write(master, b"heard all the same")
    pieces: list[Piece] = []
    while not pieces:
        pieces = link.receive()
    assert pieces[0].data == b"heard all the same"
    link.close()
    link.send(b"nowhere", [])
    os.close(master)
    os.close(slave)


@pytest.mark.skipif(find_spec("serial") is None, reason="no serial port package (pip install pyserial)")
def test_a_serial_device_that_disappears_is_tried_once_a_second(tmp_path: Path) -> None:
    from mavhums.live.streams import SerialLink

    device, clocks = tmp_path / "tty", Clocks()
    link = None
    senders = []
    for lost in (0, 1):
        master, slave = pty.openpty()
        tty.setraw(master)
        device.symlink_to(os.ttyname(slave))
        link = link or SerialLink(Address("serial", str(device), 57_600), clocks.clock)
        assert link.receive() == []
        clocks.go(999_999_000 * lost)
        assert link.receive() == []
        assert (link.fileno() < 0) == lost, "not before a second has passed"
        clocks.go(1_000 * lost)
        link.receive()
        assert link.fileno() >= 0
        os.write(master, b"x" * 3000)
        while not (pieces := link.receive()):
            assert link.fileno() >= 0
        senders.append(pieces[0].sender)
        os.close(master)
        os.close(slave)
        while link.fileno() >= 0:
            link.receive()
        device.unlink()
        link.receive()
        link.send(b"lost", [])
        assert link.unsent == 1 + lost
    assert senders[0] != senders[1]
