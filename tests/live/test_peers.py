"""Who receives what: only those who speak for a vehicle, and never more than came from them."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Hashable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.app.settings import Options
from mavhums.live.session import Session
from mavhums.live.setup import LiveOptions, prepare
from mavhums.live.status import Peers
from mavhums.log.mavlink.stamping import Piece
from tests.live.attacks import attitude

SECOND = 1_000_000


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(1, 500), st.booleans()), max_size=60))
def test_nobody_receives_more_than_came_from_him(steps: list[tuple[str, int, bool]]) -> None:
    peers = Peers()
    heard: dict[Hashable, int] = {}
    said: dict[Hashable, int] = {}
    for sender, size, hears in steps:
        if hears:
            peers.hear(sender, {1}, size, 0)
            heard[sender] = heard.get(sender, 0) + size
        elif peers.afford(sender, size):
            said[sender] = said.get(sender, 0) + size
    assert all(said[sender] <= heard.get(sender, 0) for sender in said)


def test_of_many_peers_those_are_kept_from_which_most_came() -> None:
    peers = Peers()
    for k in range(20_000):
        if k % 100 == 0:
            peers.hear("router", {1}, 400, k)
        peers.hear(("spoofed", k), {1}, 21, k)
        assert len(peers) <= 128
    peers.forget(20_000)
    assert len(peers) == 64
    assert "router" in peers.senders_for(1, 20_000)


class Stranger:
    """A socket of its own."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.sent = self.got = 0

    def send(self, data: bytes) -> None:
        self.sent += self.socket.send(data)

    def drain(self) -> list[bytes]:
        came = []
        while True:
            try:
                came.append(self.socket.recv(300))
            except BlockingIOError:
                self.got += sum(map(len, came))
                return came


def hear(session: Session) -> None:
    """Fetch what has arrived over the loopback."""
    until = time.monotonic() + 60
    pieces: list[Piece] = []
    while not pieces and time.monotonic() < until:
        pieces = [piece for link in session.links for piece in link.receive()]
    session.take(pieces)


@pytest.fixture
def session() -> Iterator[Session]:
    session = prepare(LiveOptions(urls=["udpin:0"], judging=Options(airframe="paper"), alerts=True))
    yield session
    session.close()


@pytest.fixture
def strangers(session: Session) -> Iterator[list[Stranger]]:
    strangers = [Stranger(session.links[0].address.port) for _ in range(3)]
    yield strangers
    for stranger in strangers:
        stranger.socket.close()


@pytest.mark.slow
def test_alerts_are_not_reflected(
    session: Session, strangers: list[Stranger], worn_pieces: list[Piece]
) -> None:
    """One datagram in the name of a judged vehicle, and one in that of another, from elsewhere."""
    vehicle, reflector, other = strangers
    for first in range(0, 4000, 100):
        for piece in worn_pieces[first : first + 100]:
            vehicle.send(piece.data)
        hear(session)
    reflector.send(attitude(1, 1))
    other.send(attitude(7, 1))
    hear(session)
    for _ in range(20):
        session.tick()
    assert {frame[7] for frame in vehicle.drain()} == {0, 251, 253}, "heartbeats, health and the alert"
    reflector.drain()
    assert reflector.got <= reflector.sent
    assert other.drain() == [], "its vehicle is not judged"
    assert session.status.link(session._engine.assessment(), session.clock.now_us()).contested == (1,)


def test_an_address_to_which_nothing_can_be_sent_silences_nobody(session: Session) -> None:
    link = session.links[0]
    bad = [("127.0.0.1", 0), ("255.255.255.255", 9)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(60)
        link.send(b"frame", [(link.address, peer) for peer in [*bad, ground.getsockname(), *bad]])
        assert ground.recv(300) == b"frame"
    assert link.unsent == 4


def test_a_peer_that_has_closed_costs_only_what_is_sent_to_it() -> None:
    """The error of one datagram is reported at the next."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(60)
        port = ground.getsockname()[1]
        session = prepare(LiveOptions(urls=["udpin:0"], alerts_to=f"udpout:127.0.0.1:{port}"))
    link = session.status.alert_links[-1]
    send: Callable[[bytes, int], None] = session._alerts._send  # type: ignore[union-attr]
    send(bytes(v2.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3).pack(v2.MAVLink(None))), 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", port))
        ground.settimeout(60)
        send(b"second", 1)
        assert ground.recv(300) == b"second"
    assert link.unsent == 0
    session.close()


@pytest.mark.parametrize("silent", [False, True])
def test_a_vehicle_is_greeted_without_alerts_too(silent: bool) -> None:
    session = prepare(LiveOptions(urls=["udpin:0"], silent=silent))
    vehicle = Stranger(session.links[0].address.port)
    for k in range(40):
        vehicle.send(attitude(7, k))
        vehicle.send(attitude(255, k))
    hear(session)
    session.tick()
    frames = vehicle.drain()
    assert [(frame[5], frame[7]) for frame in frames] == ([] if silent else [(7, 0)])
    assert vehicle.got <= vehicle.sent
    vehicle.socket.close()
    session.close()
