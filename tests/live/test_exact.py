"""What links, spools, queues and signatures do in exact numbers, on sockets and clocks of the test."""

from __future__ import annotations

import os
import socket
import struct
from types import SimpleNamespace
from typing import Any

import pytest

from mavhums.live.alerts import Signer
from mavhums.live.links import Address, ReceiveClock, UdpLink
from mavhums.live.outlet import BoundedQueue, Spool
from mavhums.live.status import Peers
from mavhums_sim.link import EPOCH_US

SECOND = 1_000_000


def test_the_kernel_tells_when_a_datagram_came_and_how_many_it_dropped() -> None:
    """SO_TIMESTAMPNS carries a timespec, SO_RXQ_OVFL a count of 32 bits (socket(7))."""
    link = UdpLink(Address("udpin", "127.0.0.1", 0), ReceiveClock())
    level, stamp, overflow = socket.SOL_SOCKET, 35, 40
    spec = struct.pack("@qq", 5, 7)
    assert link._received_ns([(level, overflow, struct.pack("@I", 9)), (level, stamp, spec)]) == 5_000_000_007
    assert link._received_ns([(level + 1, stamp, spec), (level, 1, spec)]) is None
    assert link.dropped == 9
    link.close()


def test_datagrams_have_times_that_grow_since_the_port_was_empty_last() -> None:
    wall = [EPOCH_US * 1000]
    link = UdpLink(Address("udpin", "127.0.0.1", 0), ReceiveClock(lambda: wall[0], lambda: wall[0]))
    link.close()
    waiting: list[Any] = []

    def receive(into: list[memoryview], room: int) -> Any:
        if not waiting:
            raise BlockingIOError
        size, stamp_us = waiting.pop(0)
        if not size:
            raise ConnectionRefusedError
        into[0][:size] = b"x" * size
        spec = struct.pack("@qq", *divmod(stamp_us * 1000, 1_000_000_000))
        return size, [(socket.SOL_SOCKET, 35, spec)], 0, ("127.0.0.1", size)

    link._socket = SimpleNamespace(recvmsg_into=receive)  # type: ignore[assignment]

    def told(*queue: Any, later_us: int = 0) -> list[tuple[int, int]]:
        wall[0] += later_us * 1000
        waiting.extend(queue)
        return [(len(piece.data), piece.time_us - EPOCH_US) for piece in link.receive()]

    at = [EPOCH_US + 100 * k for k in range(10)]
    assert told((3, at[2]), (4, at[1]), (5, at[3]), later_us=400) == [(3, 200), (4, 200), (5, 300)]
    assert told((1, at[5]), (0, 0), later_us=200) == [(1, 500)], "a refused one ends this look"
    assert told((2, at[4]), later_us=200) == [(2, 500)], "not older than the one before"
    assert told((9, at[9]), later_us=100) == [(9, 900)]
    assert told((9, at[0]), later_us=5_000_000) == [(9, 900)], (
        "what is impossible came when it was empty last"
    )
    assert told() == []
    assert [len(told(*[(1, at[9])] * count)) for count in (5000, 0)] == [4096, 904]


def test_a_torn_line_is_ended_before_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """A write that took a part leaves a torn line, until a whole one begins after a line break."""
    taken: list[int] = []
    shown = bytearray()

    def write(_: int, data: memoryview) -> int:
        count = taken.pop(0) if taken else len(data)
        if count == 0:
            raise BlockingIOError
        shown.extend(bytes(data[:count]))
        return min(count, len(data))

    read, put = os.pipe()
    with os.fdopen(put, "w", encoding="utf-8") as stream:
        spool = Spool(stream, "pipe", report=None)
        monkeypatch.setattr(os, "write", write)
        for queue, text, expected in (
            ([0], "never\n", b""),
            ([], "whole\n", b"whole\n"),
            ([2, 0], "torn\n", b"whole\nto"),
            ([0], "nothing\n", b"whole\nto"),
            ([1, 1, 0], "again\n", b"whole\nto\na"),
            ([], "line\n", b"whole\nto\na\nline\n"),
            ([], "last\n", b"whole\nto\na\nline\nlast\n"),
        ):
            taken[:] = queue
            if 0 in queue:
                with pytest.raises(BlockingIOError):
                    spool._write_text(text)
            else:
                spool._write_text(text)
            assert bytes(shown) == expected
        monkeypatch.undo()
        assert spool.finish(float("inf"))
    os.close(read)


def test_a_queue_drops_the_oldest_beyond_its_room() -> None:
    queue: BoundedQueue[str] = BoundedQueue(10)
    for item, weight in (("a", 4), ("b", 3), ("c", 3)):
        queue.put(item, weight)
    assert queue.dropped == 0
    queue.put("d", 1)
    assert (queue.dropped, queue.pop(), queue.pop()) == (1, "b", "c")
    queue.put("e", 10)
    assert (queue.dropped, queue.pop(), bool(queue)) == (2, "e", False)
    queue.put("huge", 11)
    assert queue.dropped == 2, "an item alone may exceed the room"
    queue.put("f", 1)
    assert (queue.dropped, queue.pop()) == (3, "f")
    for item in ("g", "h"):
        queue.put(item)
    queue.clear()
    assert (queue.dropped, bool(queue)) == (5, False)


def test_peers_count_for_ten_seconds_and_for_what_they_sent() -> None:
    peers = Peers()
    peers.hear("a", {249, 250}, 100, 0)
    peers.hear("b", {249}, 70_000, 0)
    for now_us, heard in ((10 * SECOND, True), (10 * SECOND + 1, False)):
        assert peers.vehicles(now_us) == [249] * heard, "250 and above are ground stations"
        assert peers.senders_for(249, now_us) == ["a", "b"] * heard
        assert peers.contested(now_us) == [249] * heard
    assert [peers.afford("a", size) for size in (60, 41, 40, 1)] == [True, False, True, False]
    assert [peers.afford("b", size) for size in (1 << 16, 1)] == [True, False], "at most 64 kB are owed"
    assert not peers.afford("stranger", 0)
    peers.forget(10 * SECOND)
    assert len(peers) == 2
    peers.forget(10 * SECOND + 1)
    assert len(peers) == 0


def test_a_clock_that_was_set_is_read_by_its_former_setting_where_the_present_one_is_impossible() -> None:
    wall, steady = [1000 * SECOND * 1000], [0]
    clock = ReceiveClock(lambda: wall[0], lambda: steady[0])
    start_us = clock.now_us()
    steady[0] += SECOND * 1000
    wall[0] += 101 * SECOND * 1000  # set 100 s ahead
    before, after = (1000 * SECOND + SECOND // 2) * 1000, wall[0] - SECOND // 4 * 1000
    assert clock.at_us([before, after], start_us) == [start_us + SECOND // 2, start_us + 3 * SECOND // 4]
    assert clock.at_us([before - SECOND * 1000], start_us) == [start_us], "by both, before the start"
    wall[0] += 50_000_000  # as NTP slews it: no setting
    assert clock.at_us([before], start_us) == [start_us + SECOND // 2]
    wall[0] += 50_000_001  # set, so that the former setting is that of 100 s
    late = wall[0] - SECOND // 4 * 1000
    assert clock.at_us([late], start_us) == [start_us + 3 * SECOND // 4], "possible by both: the present one"


def test_time_stamps_of_signatures_grow() -> None:
    """MAVLink counts tens of microseconds since 2015-01-01, 1,420,070,400 s of UTC."""
    newest = [0]
    signer = Signer(bytes(32), lambda: newest[0])
    now_us = 1_420_070_400 * SECOND + 1_000
    assert [signer.ticks(now_us), signer.ticks(now_us), signer.ticks(now_us + 90)] == [100, 101, 109]
    newest[0] = 500
    assert [signer.ticks(now_us), signer.ticks(now_us)] == [501, 502]
