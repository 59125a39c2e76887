"""What links, outputs, alerts and the status do in exact numbers, on sockets and clocks of the test."""

from __future__ import annotations

import errno
import io
import json
import os
import socket
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as v2
from rich.console import Console

from mavhums.core.errors import MavhumsError
from mavhums.engine.events import AirframeNamed, ConditionChanged, Notice, Samples, Window
from mavhums.live import Address
from mavhums.live.alerts import Alerts, Signer, text_of
from mavhums.live.links import ReceiveClock, UdpLink
from mavhums.live.outlet import BoundedQueue, Outlet, Spool
from mavhums.live.recorder import TlogRecorder
from mavhums.live.sinks import JsonLines, PlainLines, RerunSink, ThreadedSink, draw
from mavhums.live.status import Peers, Reception, SessionStatus, utc
from mavhums.live.streams import TcpLink
from mavhums.log.mavlink.stamping import Counts
from mavhums.results.live import LinkStatus, OutputStatus, RecordStatus, StaleObject, StatusObject
from mavhums.results.standing import Interval
from mavhums.results.verdict import Suspect, Verdict
from mavhums_sim.link import EPOCH_US
from tests.live.test_alerts import Ground, status

SECOND = 1_000_000


class Server:
    """The far end of a TCP connection, as the socket sees it."""

    def __init__(self) -> None:
        self.codes = [errno.EINPROGRESS]
        self.sockets = self.asked = 0
        self.open = False
        self.waiting: list[bytes | OSError] = []
        self.got = b""

    def __call__(self, *_: object) -> Server:
        self.sockets += 1
        self.open = True
        return self

    def connect_ex(self, target: object) -> int:
        self.asked += 1
        return self.codes.pop(0)

    def recv(self, size: int) -> bytes:
        if not self.waiting:
            raise BlockingIOError
        came = self.waiting.pop(0)
        if isinstance(came, OSError):
            raise came
        return came[:size]

    def send(self, data: bytes) -> int:
        self.got += data
        return len(data)

    def setblocking(self, blocks: bool) -> None:
        assert not blocks, "a link never waits"

    def fileno(self) -> int:
        return 7

    def close(self) -> None:
        self.open = False


def test_a_tcp_link_connects_loses_and_connects_again(monkeypatch: pytest.MonkeyPatch) -> None:
    server, now_us, said = Server(), [EPOCH_US], list[str]()
    log = SimpleNamespace(
        **dict.fromkeys(("info", "warning"), lambda text, *given: said.append(text % given))
    )
    monkeypatch.setattr("mavhums.live.streams._LOG", log)
    address = Address("tcp", "127.0.0.1", 5760)
    link = TcpLink(address, ReceiveClock(lambda: now_us[0] * 1000, lambda: now_us[0] * 1000))
    monkeypatch.setattr("mavhums.live.streams.socket.socket", server)

    def step(*codes: int, later_us: int = 0) -> list[tuple[Any, int, bytes]]:
        now_us[0] += later_us
        server.codes = list(codes)
        return [(piece.sender, piece.time_us - EPOCH_US, piece.data) for piece in link.receive()]

    link.send(b"too early", [])
    assert (link.fileno(), link.unsent, server.sockets) == (-1, 1, 0)
    assert step(errno.EINPROGRESS) == step(errno.EALREADY) == []
    assert (link.fileno(), server.sockets, server.asked) == (-1, 1, 2)
    link.send(b"while connecting", [])
    assert (link.unsent, server.got) == (2, b"")
    server.waiting = [b"a", b"b"]
    assert step(0, later_us=5) == [((address, 1), 5, b"a")]
    assert link.fileno() == 7
    assert step(later_us=1) == [((address, 1), 6, b"b")], "connected, it does not connect again"
    assert step() == []
    link.send(b"alert", [])
    assert (server.got, link.unsent) == (b"alert", 2)
    server.waiting = [b""]
    assert step() == []
    assert (link.fileno(), server.open) == (-1, False)
    assert step() == []
    assert server.sockets == 1, "it waits for a second"
    for _ in range(2):
        assert step(errno.ECONNREFUSED, later_us=SECOND) == []
    assert (server.sockets, server.open) == (3, False)
    server.waiting = [OSError(errno.ECONNRESET, "reset")]
    assert step(errno.EISCONN, later_us=SECOND) == []
    server.waiting = [b"c"]
    assert step(0, later_us=SECOND) == [((address, 3), 4 * SECOND + 6, b"c")]
    tries = "; trying again every second"
    assert [text.partition(": ")[2] for text in said] == [
        "connected",
        f"no connection (closed by the other end){tries}",
        "connected",
        f"no connection (reset){tries}",
        "connected",
    ]
    link.close()
    assert (link.fileno(), server.open) == (-1, False)


def test_a_udp_link_answers_those_who_speak_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    link = UdpLink(Address("udpin", "127.0.0.1", 0), ReceiveClock())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(60)
        mine, other = vehicle.getsockname(), Address("udpin", "127.0.0.1", 1)
        link.send(b"alert", [(other, mine), "serial", (link.address, mine)])
        assert vehicle.recv(100) == b"alert"
        vehicle.setblocking(False)
        with pytest.raises(BlockingIOError):
            vehicle.recv(100)
        peer = UdpLink(Address("udpout", *mine), ReceiveClock())
        peer.send(b"to its peer", [])
        vehicle.settimeout(60)
        assert vehicle.recv(100) == b"to its peer"
        assert peer.address.port == mine[1]
        peer.close()
    assert link.unsent == 0
    errors: list[OSError | None] = []

    def send(data: bytes) -> None:
        error = errors.pop(0)
        if error:
            raise error

    refused, unreachable = ConnectionRefusedError(), OSError(errno.ENETUNREACH, "unreachable")
    for queue, left, unsent in (
        ([refused, None], 0, 0),
        ([refused, refused], 0, 1),
        ([unreachable, None], 1, 2),
    ):
        errors[:] = queue
        link._try(send, b"x")
        assert (len(errors), link.unsent) == (left, unsent)
    link.close()


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


def test_of_too_many_peers_those_stay_that_sent_most() -> None:
    peers = Peers()
    for k in range(128):
        peers.hear(k, {1}, 10 + k, 0)
    peers.hear(5, {1}, 1, 0)
    assert len(peers) == 128, "who is known makes no room"
    peers.hear("new", {1}, 1, 0)
    assert set(peers.senders_for(1, 0)) == {"new", *range(64, 128)}


def test_the_words_of_an_alert_fit_its_fifty_characters() -> None:
    for actuator, fault, text in (
        ("elevator", "supply_sag", "elevator EMERGENCY: supply sag, land now"),
        ("fin", "jam", "fin EMERGENCY: jam, land as soon as possible"),
        ("a" * 40, "friction", f"{'a' * 20} EMERGENCY: friction, land now"),
        ("elevator", "f" * 40, f"elevator EMERGENCY: {'f' * 20}, land now"),
        ("yaw", "control 5%: rudder?", "YAW control 5%: rudder?, land as soon as possible"),
        ("yaw", "control 5%", "yaw EMERGENCY: control 5%, land now"),
    ):
        assert text_of(actuator, "emergency", fault) == text


def test_every_frame_of_an_alert_is_numbered_and_signed_on_its_own_link() -> None:
    ground = Ground(key=bytes(32))
    alerts = Alerts(ground.hear, component=77, signer=Signer(bytes(32)), start_us=EPOCH_US)
    later = EPOCH_US + (2**32 + 5) * 1000
    actuators = [status("a", "unchanged"), status("b", "changed"), status("quiet", "normal", vehicle=5)]
    actuators[2] = actuators[2].model_copy(update={"age_s": None})
    alerts.tick(actuators, later, heard=[9])
    assert {frame[-13] for frame in ground.frames} == {77}, "the link's id stands before time and signature"
    messages = ground.heard()
    values = [m for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert [(m.name, m.value, m.time_boot_ms) for m in values] == [("H1a", 1.0, 5), ("H2b", 0.5, 5)]
    beats = [m for m in messages if m.get_type() == "HEARTBEAT"]
    assert [m.get_srcSystem() for m in beats] == [3, 9]
    for beat in beats:
        assert (beat.base_mode, beat.custom_mode, beat.system_status) == (0, 0, v2.MAV_STATE_ACTIVE)
    for _ in range(300):
        alerts.heartbeat(9, later)
    assert [m.get_seq() for m in ground.heard()] == [k % 256 for k in range(1, 301)]


def verdict(actuator: str, **fields: Any) -> Verdict:
    return Verdict(vehicle=1, actuator=actuator, condition="normal", worst="degraded", **fields)


def assessed(*verdicts: Verdict) -> Any:
    loss = SimpleNamespace(missing=3, reordered=2, duplicated=1)
    return SimpleNamespace(
        verdicts=verdicts, log=SimpleNamespace(losses=SimpleNamespace(sequence=[loss, loss]))
    )


def samples(actuator: str, count: int) -> Samples:
    return Samples(1, actuator, np.arange(count) / 100.0, np.zeros((count, 12)))


def session_status(recorder: TlogRecorder | None = None) -> tuple[SessionStatus, SimpleNamespace]:
    stamper = SimpleNamespace(counts=Counts(pieces=4, frames=100, bytes=5000, bad_crc_frames=2))
    links: list[Any] = [
        SimpleNamespace(dropped=2, unsent=0, address="udpin:1"),
        SimpleNamespace(dropped=3, unsent=4, address="tcp:h:2"),
    ]
    clock = ReceiveClock(lambda: EPOCH_US * 1000, lambda: 0)
    fed: Any = stamper
    return SessionStatus(Reception(fed, links, clock), recorder), stamper


def test_the_status_has_ages_and_rates() -> None:
    seen, stamper = session_status()
    both = assessed(verdict("elevator"), verdict("rudder"), verdict("roll", subject="axis"))
    status_, stale = seen.report(both, EPOCH_US)
    assert stale == []
    assert [one.age_s for one in status_.actuators] == [None] * 3
    assert [one.stale for one in status_.actuators] == [False, False, True]
    assert status_.link.age_s is None
    seen.observe([samples("elevator", 50), samples("rudder", 10)], EPOCH_US + SECOND)
    stamper.counts = Counts(pieces=9, frames=160, bytes=9000, bad_crc_frames=2)
    seen.observe([samples("elevator", 30)], EPOCH_US + 3 * SECOND // 2)
    status_, stale = seen.report(both, EPOCH_US + 2 * SECOND)
    assert (status_.uptime_s, stale) == (2.0, [])
    assert [(a.actuator, a.age_s, a.rate_hz, a.condition) for a in status_.actuators] == [
        ("elevator", 0.5, 40.0, "normal"),
        ("rudder", 1.0, 5.0, "normal"),
        ("roll", 0.5, 0.0, "normal"),
    ]
    link = status_.link
    assert (link.age_s, link.frames_per_s, link.bytes_per_s) == (0.5, 30.0, 2000.0)
    assert (link.datagrams, link.missing_frames, link.reordered_frames, link.duplicated_frames) == (
        9,
        6,
        4,
        2,
    )
    assert (link.dropped_datagrams, link.bad_crc_frames) == (5, 2)
    assert [(o.name, o.dropped) for o in status_.outputs] == [("alerts to tcp:h:2", 4)]
    seen.observe([samples("elevator", 10)], EPOCH_US + 12 * SECOND)
    status_, stale = seen.report(both, EPOCH_US + 12 * SECOND)
    assert [(s.actuator, s.stale, s.age_s) for s in stale] == [("rudder", True, 11.0)]
    assert [(a.rate_hz, a.stale, a.condition, a.held) for a in status_.actuators] == [
        (1.0, False, "normal", "normal"),
        (0.0, True, "undecided", "normal"),
        (0.0, False, "normal", "normal"),
    ]
    assert (status_.link.frames_per_s, status_.link.bytes_per_s) == (0.0, 0.0)
    seen.observe([samples("rudder", 1)], EPOCH_US + 13 * SECOND)
    _, stale = seen.report(both, EPOCH_US + 13 * SECOND)
    assert [(s.actuator, s.stale, s.age_s) for s in stale] == [("rudder", False, 0.0)]
    status_, stale = seen.report(both, EPOCH_US + 100_013 * SECOND + 123_456)
    assert (status_.uptime_s, status_.link.age_s) == (100_013.123, 100_000.123)
    assert [(s.actuator, s.age_s) for s in stale] == [("elevator", 100_001.123), ("rudder", 100_000.123)]


def test_the_lines_of_a_session(tmp_path: Any) -> None:
    recorder = TlogRecorder(tmp_path / "a.tlog")
    lines: list[dict[str, Any]] = []
    for kept in (None, recorder):
        out = JsonLines(
            lambda line: lines.append(json.loads(line)), lambda: EPOCH_US, session_status(kept)[0]
        )
        out.start(["udpin:1"], airframe=None, signed_only=False)
    recorder.close()
    assert [line["record"] for line in lines] == [None, str(tmp_path / "a.tlog")]
    said: list[str] = []
    plain = PlainLines(said.append)
    event = ConditionChanged(1, "rudder", 20.0, 10.0, "normal", "degraded", "rule", "jam")
    well = ConditionChanged(1, "rudder", 25.0, 11.0, "degraded", "normal", "rule")
    plain.consume([samples("rudder", 3), event])
    plain.consume([well])
    seen, _ = session_status()
    status_, _ = seen.report(assessed(), EPOCH_US + 30 * SECOND)
    gone = StaleObject(utc="", vehicle=1, actuator="rudder", stale=True, age_s=3.25)
    plain.tick(status_, [gone, gone.model_copy(update={"stale": False})])
    assert said == [
        "    20.0 s  vehicle 1, rudder: normal → degraded (jam), since 10.0 s",
        "    25.0 s  vehicle 1, rudder: degraded → normal, since 11.0 s",
        "    30.0 s  vehicle 1, rudder: stale, silent for 3.2 s",
        "    30.0 s  vehicle 1, rudder: received again",
    ]


def test_what_waits_for_a_viewer_weighs_its_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    weights: list[int] = []
    sink: Any = SimpleNamespace(consume=lambda events: None)
    threaded = ThreadedSink(sink, "viewer", lambda: None)
    put: Callable[..., None] = lambda item, weight=1: weights.append(weight)  # noqa: E731
    monkeypatch.setattr(threaded.outlet, "put", put)
    threaded.consume([samples("a", 30), samples("b", 12)])
    threaded.consume([])
    assert weights == [43, 1]
    monkeypatch.undo()
    assert threaded.finish()


def test_an_event_is_a_line_with_its_fields() -> None:
    lines: list[dict[str, Any]] = []
    out = JsonLines(lambda line: lines.append(json.loads(line)), lambda: EPOCH_US, session_status()[0])
    profile: Any = SimpleNamespace(name="paper")
    out.consume(
        [
            samples("rudder", 3),
            AirframeNamed(1.5, 7, profile),
            Window(1, "rudder", 10.0, 20.0, 0.123456, None, "normal", "normal", 0.75, 0.25),
            ConditionChanged(1, "rudder", 20.0, 10.0, "normal", "degraded", "rule", "jam"),
            ConditionChanged(1, "rudder", 30.0, 25.0, "degraded", "normal", "rule", "jam"),
            Notice(4.0, None, "PreArm"),
        ]
    )
    assert {line.pop("utc") for line in lines} == {utc(EPOCH_US)}
    rudder = {"vehicle": 1, "actuator": "rudder"}
    window = {"start_s": 10.0, "end_s": 20.0, "moving_fraction": 0.1235, "friction_nm": None}
    worse = {"time_s": 20.0, "since_s": 10.0, "before": "normal", "after": "degraded", "fault": "jam"}
    well = {"time_s": 30.0, "since_s": 25.0, "before": "degraded", "after": "normal", "fault": None}
    assert lines == [
        {"event": "airframe", "time_s": 1.5, "vehicle": 7, "airframe": "paper"},
        {
            "event": "window",
            **rudder,
            **window,
            "network": "normal",
            "probability": 0.75,
            "condition": "normal",
        },
        {"event": "condition", **rudder, **worse, "rule": "rule"},
        {"event": "condition", **rudder, **well, "rule": "rule"},
        {"event": "notice", "time_s": 4.0, "vehicle": None, "text": "PreArm"},
    ]


def test_a_viewer_that_stops_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    class Drawing:
        """A drawing that fails from its second call on."""

        calls = 0

        def consume(self, events: object) -> None:
            self.calls += 1
            if self.calls > 1:
                raise RuntimeError("the viewer is gone")

    state: Any = None
    recording: Any = Drawing()
    sink = RerunSink(recording)
    sink.tick(state, [])
    sink.consume([])
    assert caplog.messages == []
    for _ in range(2):
        sink.consume([])
    assert recording.calls == 3, "it is tried again"
    recording.trouble = "the viewer has crashed"
    sink.tick(state, [])
    assert caplog.messages == ["drawing has ended: the viewer is gone"]
    caplog.clear()
    watched: Any = SimpleNamespace(trouble="")
    sink = RerunSink(watched)
    sink.tick(state, [])
    watched.trouble = "the viewer has crashed"
    for _ in range(2):
        sink.tick(state, [])
    assert caplog.messages == ["the viewer has crashed"]


def test_the_table_on_the_terminal_has_a_row_for_each_actuator() -> None:
    first = status("rudder", "emergency").model_copy(
        update={
            "friction_nm": Interval(estimate=0.5, low=0.4, high=0.6),
            "network": "friction_degraded",
            "probability": 0.25,
            "rate_hz": 49.6,
            "age_s": 0.26,
            "late": 1234,
            "suspects": (Suspect(fault="jam", confidence=0.5), Suspect(fault="wear", confidence=0.1)),
        }
    )
    second = status("roll", "undecided").model_copy(
        update={"vehicle": None, "age_s": None, "stale": True, "held": "normal"}
    )
    link = session_status()[0].link(assessed(), EPOCH_US).model_copy(update={"contested": (4,), "age_s": 1.5})
    state = StatusObject(
        utc="", uptime_s=61.0, actuators=(first, second), link=link, record=None,
        outputs=(OutputStatus(name="viewer", dropped=1234, error=None),),
    )  # fmt: skip

    def shown(state: StatusObject, *latest: str) -> list[str]:
        console = Console(file=io.StringIO(), width=200)
        console.print(draw(state, "udpin:14550", latest))
        text = console.file.getvalue()  # type: ignore[attr-defined]
        return [" ".join(line.split()) for line in text.splitlines() if line.strip()]

    lines = shown(state, "1:00 latest")
    assert "3 rudder EMERGENCY: jam 0.500 (0.400–0.600) friction degraded (25 %) 50 Hz 0.3 s 1,234" in lines
    assert "— roll STALE, was normal — — 100 Hz — 0" in lines
    assert lines[-6:] == [
        "1:00 latest",
        "vehicle 4: more than one sender transmits as it",
        "last data 1.5 s ago; 100 frames/s, 5.0 kB/s; 100 frames",
        "lost or refused: 6 missing by sequence number, 4 out of order, 2 duplicated, "
        "2 with a wrong checksum, 5 datagrams dropped by the kernel",
        "viewer: 1,234 dropped",
        "Ctrl-C ends and prints the verdicts",
    ]
    nothing: dict[str, Any] = dict.fromkeys(LinkStatus.model_fields, 0)
    quiet = LinkStatus(**nothing | {"age_s": None, "contested": ()})
    record = RecordStatus(path="a.tlog", bytes=1_250_000, lost_frames=0, error=None)
    broken = record.model_copy(update={"error": "disk full", "lost_frames": 1234})
    lossy = (OutputStatus(name="viewer", dropped=1, error="hangs"),)
    calm = state.model_copy(update={"link": quiet, "record": record, "outputs": lossy})
    lines = shown(calm)
    assert "nothing received yet; 0 frames/s, 0.0 kB/s; 0 frames" in lines
    assert "lost or refused: nothing" in lines
    assert "recording a.tlog, 1.2 MB" in lines
    assert "viewer: 1 dropped (hangs)" in lines
    assert "NOT RECORDED: disk full; 1,234 frames lost" in shown(calm.model_copy(update={"record": broken}))


def test_a_recorder_writes_all_or_takes_back_what_it_wrote(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = TlogRecorder(tmp_path / "a.tlog")
    write, takes = os.write, [2, 1]

    def partly(file: int, data: bytes) -> int:
        if not takes:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[: takes.pop(0)])

    recorder.write(b"first", 2)
    recorder.write(b"", 9)
    with monkeypatch.context() as full:
        full.setattr(os, "write", partly)
        recorder.write(b"second", 3)
    assert (recorder.path.read_bytes(), recorder.bytes, recorder.lost_frames) == (b"first", 5, 3)
    assert recorder.error == "No space left on device"
    takes = [2, 9]
    with monkeypatch.context() as slow:
        slow.setattr(os, "write", partly)
        recorder.write(b"third", 1)
    recorder.close()
    assert (recorder.path.read_bytes(), recorder.bytes, recorder.lost_frames) == (b"firstthird", 10, 3)
    assert recorder.error is None
    with pytest.raises(MavhumsError, match="exists already"):
        TlogRecorder(tmp_path / "a.tlog")


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


@pytest.mark.parametrize(
    ("error", "why", "gone"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device", False),
        (OSError("no number"), "no number", False),
        (ValueError("bad text"), "bad text", False),
        (ValueError(), "ValueError()", False),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), "Broken pipe", True),
    ],
)
def test_an_outlet_says_why_an_item_failed(error: Exception, why: str, gone: bool) -> None:
    failing = [True]

    def take(item: object) -> None:
        if failing[0]:
            raise error

    said: list[str] = []
    outlet: Outlet[object] = Outlet("disk", take, report=said.append)
    outlet._hand_over(None)
    outlet._hand_over(None)
    assert (outlet.error, outlet.gone, outlet.dropped) == (why, gone, 2)
    failing[0] = False
    outlet._hand_over(None)
    outlet._hand_over(None)
    assert (outlet.error, outlet.gone, outlet.dropped) == (None, gone, 2)
    lost = f"disk: {why}; its output is dropped, everything else continues"
    assert said == [lost, "disk: works again; 2 dropped"]
    assert outlet.close(30)
    outlet.put(None)
    outlet.put(None)
    assert outlet.dropped == 4, "refused after the end"


def test_data_are_stale_after_three_seconds_and_not_at_three() -> None:
    seen, _ = session_status()
    both = assessed(verdict("elevator"), verdict("roll", subject="axis"), verdict("all"), verdict("rudder"))
    seen.observe([samples("elevator", 1)], EPOCH_US)
    for later_us, stale in ((3 * SECOND, False), (3 * SECOND + 1, True)):
        state, changes = seen.report(both, EPOCH_US + later_us)
        assert [one.stale for one in state.actuators] == [stale, stale, stale, False]
        assert len(changes) == stale
    assert seen.report(both, EPOCH_US + 9 * SECOND)[1] == [], "a change is reported once"


def test_a_recording_and_lost_outputs_are_in_the_state(tmp_path: Any) -> None:
    recorder = TlogRecorder(tmp_path / "a.tlog")
    recorder.write(b"12345", 2)
    recorder.close()
    seen, _ = session_status(recorder)
    lossy: Any = SimpleNamespace(name="viewer", dropped=2, error="hangs")
    sound: Any = SimpleNamespace(name="other", dropped=0, error=None)
    seen.outlets += [sound, lossy]
    state, _ = seen.report(assessed(), EPOCH_US)
    path = str(tmp_path / "a.tlog")
    assert state.record == RecordStatus(path=path, bytes=5, lost_frames=0, error=None)
    assert [(one.name, one.dropped, one.error) for one in state.outputs] == [
        ("viewer", 2, "hangs"),
        ("alerts to tcp:h:2", 4, None),
    ]


def test_time_stamps_of_signatures_grow() -> None:
    """MAVLink counts tens of microseconds since 2015-01-01, 1,420,070,400 s of UTC."""
    newest = [0]
    signer = Signer(bytes(32), lambda: newest[0])
    now_us = 1_420_070_400 * SECOND + 1_000
    assert [signer.ticks(now_us), signer.ticks(now_us), signer.ticks(now_us + 90)] == [100, 101, 109]
    newest[0] = 500
    assert [signer.ticks(now_us), signer.ticks(now_us)] == [501, 502]
