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
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.live.links import Address, Outgoing, ReceiveClock, TcpLink, UdpLink
from mavhums.live.session import Session
from mavhums.log.mavlink.stamping import Piece

SECOND = 1_000_000_000
SECOND_US = 1_000_000


class Clocks:
    """A wall clock that can be set, and a steady one."""

    def __init__(self) -> None:
        self.wall, self.steady = 1_700_000_000 * SECOND, 5 * SECOND
        self.clock = ReceiveClock(lambda: self.wall, lambda: self.steady)

    def go(self, nanoseconds: int) -> int:
        self.wall += nanoseconds
        self.steady += nanoseconds
        return self.wall


def test_what_waited_through_a_stall_keeps_its_time() -> None:
    clocks = Clocks()
    began_us = clocks.clock.now_us()
    stamps = [clocks.go(SECOND // 2) for _ in range(40)]
    times = clocks.clock.at_us(stamps, began_us)
    assert [time_us - began_us for time_us in times] == [500_000 * k for k in range(1, 41)]


@given(step_s=st.integers(-100_000, 100_000), at=st.integers(0, 39))
def test_a_clock_that_is_set_in_a_stall_moves_nothing_much(step_s: int, at: int) -> None:
    """No time is out of order, or outside the stall; where the step is longer than it, each is exact."""
    clocks = Clocks()
    began_us = clocks.clock.now_us()
    stamps = []
    for k in range(40):
        stamps.append(clocks.go(SECOND // 2))
        if k == at:
            clocks.wall += step_s * SECOND
    times = [time_us - began_us for time_us in clocks.clock.at_us(stamps, began_us)]
    assert all(0 <= time_us <= 20_000_000 for time_us in times)
    if abs(step_s) > 20:
        assert times == [500_000 * k for k in range(1, 41)]


def test_without_a_bound_nothing_is_older_than_a_second() -> None:
    clocks = Clocks()
    now_us = clocks.clock.now_us()
    assert clocks.clock.at_us([clocks.wall - 9 * SECOND, clocks.wall + SECOND, None]) == [
        now_us - 1_000_000,
        now_us,
        now_us,
    ]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the kernel tells no times of reception")
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
    from mavhums.live.links import SerialLink

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
def test_a_serial_device_that_disappears_is_tried_once_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    from pymavlink import mavutil

    from mavhums.live.links import SerialLink

    class Port:
        fd: int | None = 7
        there, opened = True, 0
        data = b"x" * 70_000

        def __init__(self, device: str, baud: int) -> None:
            type(self).opened += 1
            if not self.there:
                raise OSError(2, "No such file")
            assert (device, baud) == ("/dev/x", 57_600)
            self.port = self

        @property
        def in_waiting(self) -> int:
            if not self.there:
                raise OSError(5, "gone")
            return len(self.data)

        def read(self, count: int) -> bytes:
            taken, type(self).data = self.data[:count], self.data[count:]
            return taken

        def reset_output_buffer(self) -> None: ...

        def close(self) -> None: ...

    class Clock(ReceiveClock):
        us = 10_000_000

        def now_us(self) -> int:
            return self.us

    monkeypatch.setattr(mavutil, "mavserial", Port)
    clock = Clock()
    link = SerialLink(Address("serial", "/dev/x", 57_600), clock)
    assert link.fileno() == 7
    first, second = link.receive()[0], link.receive()[0]
    assert (len(first.data), len(second.data)) == (1 << 16, 70_000 - (1 << 16))
    assert link.receive() == []
    assert first.sender == second.sender
    Port.there = False
    assert link.receive() == []
    assert link.fileno() == -1
    tried = []
    for _ in range(35):
        before = Port.opened
        assert link.receive() == []
        tried += [clock.us] * (Port.opened - before)
        clock.us += 100_000
    assert tried == [10_000_000 + k * 1_000_000 for k in range(4)]
    link.send(b"lost", [])
    assert link.unsent == 1
    Port.there, Port.data = True, b"again"
    clock.us += 1_000_000
    assert link.receive() == []
    [piece] = link.receive()
    assert (piece.data, piece.time_us) == (b"again", clock.us)
    assert piece.sender != first.sender
    Port.fd = None
    assert link.fileno() == -1


@pytest.mark.parametrize(
    ("pending_us", "due_us", "readable", "stamped", "busy", "waited"),
    [
        (None, 9_000_000, True, True, False, ("select", 0.1)),
        (None, 1_030_000, True, True, False, ("select", 0.03)),
        (None, 900_000, True, True, False, ("select", 0.0)),
        (None, 9_000_000, False, True, False, ("sleep", 0.05)),
        (None, 9_000_000, False, False, False, ("sleep", 0.005)),
        (980_000, 9_000_000, True, True, False, ("sleep", 0.05)),
        (980_000, 9_000_000, True, True, True, ("sleep", 0.005)),
        (980_000, 9_000_000, True, False, False, ("sleep", 0.005)),
        (930_000, 9_000_000, True, True, False, ("sleep", 0.03)),
        (900_000, 9_000_000, True, True, False, ("sleep", 0.0)),
        (980_000, 1_004_000, True, True, True, ("sleep", 0.004)),
    ],
)
def test_a_session_waits_until_something_is_due_and_no_longer(
    monkeypatch: pytest.MonkeyPatch,
    pending_us: int | None,
    due_us: int,
    readable: bool,
    stamped: bool,
    busy: bool,
    waited: tuple[str, float],
) -> None:
    """It is at 1 s. Pieces are collected for 0.1 s; where they are, more come without the kernel's notice."""
    told: list[Any] = []
    monkeypatch.setattr("time.sleep", lambda s: told.append(("sleep", s)))
    monkeypatch.setattr("select.select", lambda r, w, x, s: told.append(("select", s)))
    links = [
        SimpleNamespace(fileno=lambda: 3 if readable else -1, stamped=stamped),
        SimpleNamespace(fileno=lambda: -1, stamped=True),
    ]
    clock = SimpleNamespace(now_us=lambda: 1_000_000)
    session: Any = SimpleNamespace(clock=clock, links=links, _due_us=due_us, _busy=busy)
    Session._wait(session, [] if pending_us is None else [Piece(None, pending_us, b"")])
    assert told == [(waited[0], pytest.approx(waited[1]))]


def test_two_senders_of_a_vehicle_are_warned_about_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    told: list[Any] = []
    sink = SimpleNamespace(consume=told.extend)
    session: Any = SimpleNamespace(_contested={}, _first_us=SECOND_US * 1000, sinks=[sink])
    for vehicles, second in (
        ([1], 1000),
        ([1, 2], 1030),
        ([1, 2], 1059),
        ([1], 1060),
        ([2], 1089),
        ([], 1200),
    ):
        Session._warn_contested(session, vehicles, SECOND_US * second)
    assert [(one.vehicle, one.time_s) for one in told] == [(1, 0.0), (2, 30.0), (1, 60.0)]
    assert caplog.text.count("more than one sender transmits as vehicle 1") == 2
    session._first_us = None
    Session._warn_contested(session, [3], SECOND_US * 1000)
    assert told[-1].time_s == 0.0
