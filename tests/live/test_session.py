"""What a session does with its parts: when it takes pieces, what it sends and to whom, how it ends."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from mavhums.core.conditions import Condition
from mavhums.engine.engine import Engine
from mavhums.health.decision.events import ConditionChanged
from mavhums.live.alerts import fault_of
from mavhums.live.links import Address
from mavhums.live.session import GroundStation, Session
from mavhums.live.setup import _send
from mavhums.live.status import Peers, Reception
from mavhums.log.mavlink.stamping import Counts, Piece
from mavhums.results.assessment import Assessment
from mavhums.results.live import AlertObject
from tests.flights import identity
from tests.live.conftest import Shown

SECOND = 1_000_000
START = 1_000 * SECOND
WORSE = ConditionChanged(1, "rudder", 20.0, 10.0, "normal", "degraded", "rule")


class Parts:
    """A session of parts that note what they get; time goes on by ``step_us`` at each wait."""

    def __init__(self, *, same: bool = False, links: int = 1, recorded: bool = True, **more: Any) -> None:
        self.now_us, self.step_us = START, 20_000
        self.calls: list[Any] = []
        self.received: list[list[Piece]] = []
        self.events: list[Any] = []
        self.assessed: Assessment = Engine().assessment()
        self.stamper = SimpleNamespace(
            counts=Counts(), frames=0, speaks_mavlink2=False, feed=self.feed, close=self.end
        )
        self.links = [self.link(k) for k in range(links)]
        self.heartbeats: list[int] = []
        greeter, alerts = self.sender("greeter"), self.sender("alerts")
        self.greeter, self.alerts = greeter, greeter if same else alerts
        self.peers, self.shown = Peers(), Shown()
        recorder = SimpleNamespace(
            path="live.tlog", bytes=0, lost_frames=0, error=None, close=self.note("recorder closed"),
            write=lambda records, frames: self.calls.append((len(records), frames)),
        )  # fmt: skip
        engine = SimpleNamespace(
            feed=self.judge, finish=list, assessment=lambda path=None, indicators=True: self.judged(path)
        )
        clock: Any = SimpleNamespace(now_us=lambda: self.now_us)
        parts: Any = (self.stamper, self.links, clock, self.peers, self.note("remembered"))
        given: Any = (self.alerts, self.greeter, [self.link("ground")])
        any_engine: Any = engine
        any_recorder: Any = recorder if recorded else None
        self.session = Session(
            any_engine,
            Reception(*parts),
            GroundStation(*given),
            recorder=any_recorder,
            sinks=[self.shown],
            **more,
        )
        self.session._wait = self.wait  # type: ignore[method-assign]

    def note(self, what: Any) -> Callable[[], None]:
        return lambda: self.calls.append(what)

    def link(self, name: object) -> Any:
        def receive() -> list[Piece]:
            return self.received.pop(0) if self.received else []

        address = Address("udpin", "127.0.0.1", 14550)
        return SimpleNamespace(address=address, dropped=0, unsent=0, receive=receive, close=self.note(name))

    def sender(self, name: str) -> Any:
        def tick(actuators: object, now_us: int, announced: Any) -> list[AlertObject]:
            self.heartbeats += announced
            return [AlertObject(utc="", vehicle=1, severity=4, text=f"from {name}")]

        def observe(events: object, now_us: int) -> list[AlertObject]:
            self.calls.append({"observed": events})
            return []

        def heartbeat(vehicle: int, now_us: int) -> None:
            self.heartbeats.append(vehicle)

        return SimpleNamespace(mavlink2=None, tick=tick, observe=observe, heartbeat=heartbeat)

    def wait(self, pending: object) -> None:
        self.now_us += self.step_us

    def feed(self, pieces: list[Piece]) -> bytes:
        self.calls.append([(piece.time_us - START, piece.data) for piece in pieces])
        self.stamper.frames += len(pieces)
        return b"".join(piece.time_us.to_bytes(8, "big") + piece.data for piece in pieces)

    def end(self, now_us: int) -> bytes:
        self.calls.append(("stamper closed", now_us - START))
        return b""

    def judge(self, records: bytes) -> list[Any]:
        return self.events

    def judged(self, path: str | None) -> Assessment:
        log = self.assessed.log.model_copy(update={"path": path})
        return self.assessed.model_copy(update={"log": log})

    def run(self, rounds: int) -> Assessment:
        left = iter(range(rounds))
        return self.session.run(lambda: next(left, None) is None)


def piece(late_us: int, data: bytes = b"x") -> Piece:
    return Piece("vehicle", START + late_us, data)


def taken(parts: Parts) -> list[Any]:
    return [call for call in parts.calls if isinstance(call, list)]


def test_pieces_are_taken_together_when_the_first_is_a_tenth_of_a_second_old() -> None:
    parts = Parts(links=2)
    parts.received = [[piece(20_000)], [piece(15_000)], [piece(40_000)]]
    parts.run(5)
    # At 100 ms the first piece received, of 20 ms, is 80 ms old; the end takes what waits.
    assert taken(parts) == [[(15_000, b"x"), (20_000, b"x"), (40_000, b"x")]]
    parts = Parts()
    parts.received = [[piece(20_000)], [], [], [], [], [piece(120_000)]]
    parts.run(7)
    assert taken(parts) == [[(20_000, b"x"), (120_000, b"x")]], "both at 120 ms, nothing at the end"
    assert parts.session._busy is False


def test_time_never_goes_back_in_a_recording() -> None:
    parts = Parts()
    parts.session.take([piece(9, b"b"), piece(5, b"a")])
    parts.session.take([])
    parts.session.take([piece(8, b"c"), piece(10, b"d")])
    parts.session.take([piece(10, b"e")])
    assert taken(parts) == [[(5, b"a"), (9, b"b")], [(9, b"c"), (10, b"d")], [(10, b"e")]]
    assert [call for call in parts.calls if isinstance(call, tuple)] == [(18, 2), (18, 2), (9, 1)]
    assert parts.session._first_us == START + 5


@pytest.mark.parametrize("same", [False, True])
def test_a_heartbeat_goes_to_each_vehicle_that_is_heard(same: bool, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="mavhums")
    parts = Parts(same=same)
    parts.session.tick()
    assert parts.heartbeats == [1], "ArduPilot's default, while no vehicle is heard"
    assert parts.greeter.mavlink2 is parts.alerts.mavlink2 is True, "as long as nobody has spoken"
    sent = "from greeter" if same else "from alerts"
    assert [alert.text for alert in parts.shown.alerts] == [sent]
    assert caplog.messages == [f"sent to the ground station: {sent}"]
    parts.peers.hear("vehicle", range(40, 100), 10, START)
    parts.stamper.frames = 1
    parts.session.tick()
    assert parts.heartbeats[1:] == list(range(40, 72)), "not for more than are judged"
    assert parts.greeter.mavlink2 is parts.alerts.mavlink2 is False
    parts.stamper.speaks_mavlink2 = True
    parts.session.tick()
    assert parts.alerts.mavlink2 is True
    parts.now_us += 10 * SECOND + 1
    parts.session.tick()
    assert len(parts.peers) == 0


def test_an_error_ends_a_session_with_its_verdicts() -> None:
    parts = Parts()

    def fail() -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        parts.session.run(fail)
    assert len(parts.shown.closed) == 1


@pytest.mark.parametrize(
    ("counts", "code"),
    [
        ({}, "nothing_received"),
        ({"bytes": 1234}, "no_frame"),
        ({"bytes": 9, "unsigned_frames": 1}, "no_signed_frame"),
        ({"bytes": 9, "bad_signatures": 1}, "no_signed_frame"),
        ({"bytes": 9, "replayed_frames": 1}, "no_signed_frame"),
        ({"frames": 1, "bytes": 9}, ""),
    ],
)
def test_why_nothing_is_judged_is_said(counts: dict[str, int], code: str) -> None:
    parts = Parts()
    before = parts.assessed.verdicts[0]
    parts.stamper.counts = Counts(**counts)
    (found,) = parts.session.close().verdicts
    if not code:
        assert found == before
    else:
        assert found.reason_codes == (code,)
        assert "on udpin:127" in (found.reason or "")


@pytest.mark.parametrize(
    ("after", "finding", "fault"),
    [
        ("degraded", "control 5%", "control 5%"),
        ("emergency", "", "jam"),
        ("normal", "control 5%", None),
        ("changed", "", None),
    ],
)
def test_the_fault_of_a_change_is_its_finding_else_its_cause(
    after: Condition, finding: str, fault: str | None
) -> None:
    assert fault_of(replace(WORSE, after=after, fault="jam", finding=finding)) == fault


def test_an_aircraft_is_checked_when_a_board_becomes_known() -> None:
    checked: list[int] = []

    def identify(assessment: Assessment) -> Assessment:
        checked.append(len(assessment.log.flight))
        return assessment

    parts = Parts(identify=identify)
    for flights in ((), (None,), (None,), ("0A",), ("0A",)):
        log = parts.assessed.log.model_copy(update={"flight": tuple(identity(board=one) for one in flights)})
        parts.assessed = parts.assessed.model_copy(update={"log": log})
        parts.session.tick()
    assert checked == [1, 1], "of the flight, and once more with its board"
    parts.session.close()
    assert checked == [1, 1, 1], "and at the end"


@pytest.mark.parametrize(("heard", "sent"), [(36, False), (37, True)])
def test_a_frame_and_its_headers_cost_what_was_heard(heard: int, sent: bool) -> None:
    """IPv4 and UDP add 28 bytes to a frame of nine."""
    parts = Parts()
    parts.peers.hear("vehicle", {1}, heard, START)
    parts.peers.hear("other", {2}, 1000, START)
    got: list[Any] = []
    udp, tcp = parts.links[0], parts.link("tcp")
    tcp.address = Address("tcp", "host", 1)
    udp.send = tcp.send = lambda frame, to: got.append((frame, to))
    clock: Any = SimpleNamespace(now_us=lambda: START)
    stamper: Any = None
    reception = Reception(stamper, [udp], clock, parts.peers)
    _send(reception, [tcp], b"x" * 9, 1)
    assert got == [(b"x" * 9, [])], "a stream costs no peer anything"
    _send(reception, [tcp, udp], b"x" * 9, 1)
    assert got[1:] == [(b"x" * 9, ["vehicle"] * sent)] * 2
    _send(reception, [udp], b"x" * 9, 1)
    assert got[3:] == [(b"x" * 9, [])], "it has no more credit"
