"""What links, spools, queues and signatures do in exact numbers, on sockets and clocks of the test."""

from __future__ import annotations

import os

import pytest

from mavhums.live.alerts import Signer
from mavhums.live.outlet import BoundedQueue, Spool
from mavhums.live.status import Peers

SECOND = 1_000_000


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


def test_time_stamps_of_signatures_grow() -> None:
    """MAVLink counts tens of microseconds since 2015-01-01, 1,420,070,400 s of UTC."""
    newest = [0]
    signer = Signer(bytes(32), lambda: newest[0])
    now_us = 1_420_070_400 * SECOND + 1_000
    assert [signer.ticks(now_us), signer.ticks(now_us), signer.ticks(now_us + 90)] == [100, 101, 109]
    newest[0] = 500
    assert [signer.ticks(now_us), signer.ticks(now_us)] == [501, 502]
