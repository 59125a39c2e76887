"""A session whose clock the test moves, and flights to feed it with."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest

import mavhums
from mavhums.engine.engine import Engine
from mavhums.engine.events import Event
from mavhums.engine.options import EngineOptions
from mavhums.learn import packaged_models
from mavhums.live.alerts import Alerts, Signer
from mavhums.live.links import ReceiveClock
from mavhums.live.outlet import TlogRecorder
from mavhums.live.session import GroundStation, LiveSink, Session
from mavhums.live.status import Peers, Reception
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.signing import SignatureGuard
from mavhums.log.mavlink.stamping import Piece, Stamper
from mavhums.results.assessment import Assessment
from mavhums.results.live import AlertObject, StaleObject, StatusObject
from mavhums.results.verdict import Verdict
from mavhums_sim import Flight, FlightRecord, fly
from mavhums_sim.link import EPOCH_US, Link, transmit
from mavhums_sim.telemetry import messages

KEY = bytes(range(32))


class Shown(LiveSink):
    """Keeps what a session shows."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.statuses: list[StatusObject] = []
        self.stale: list[StaleObject] = []
        self.alerts: list[AlertObject] = []
        self.closed: list[Assessment] = []

    def consume(self, events: Sequence[Event]) -> None:
        self.events += events

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        self.statuses.append(status)
        self.stale += stale

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        self.alerts += alerts

    def close(self, assessment: Assessment) -> None:
        self.closed.append(assessment)


class Rig:
    """A session on a clock of its own: pieces in, verdicts out, held against its recording."""

    def __init__(
        self,
        folder: Path,
        *,
        key: bytes | None = None,
        latest: dict[tuple[int, int, int], int] | None = None,
        start_us: int = EPOCH_US,
    ) -> None:
        self.now_us = self.wall_us = start_us
        self.shown = Shown()
        self.said: list[bytes] = []
        self.key = key
        self.guard = SignatureGuard(key, before=latest) if key else None
        self.peers = Peers()
        self.stamper = Stamper(load_dialect(), self.guard, hear=self.peers.hear)
        self.recorder = TlogRecorder(folder / "live.tlog")
        self.clock = ReceiveClock(lambda: self.wall_us * 1000, lambda: self.now_us * 1000)
        signer = Signer(key) if key else None
        self.alerts = Alerts(lambda frame, _: self.said.append(frame), signer=signer, start_us=start_us)
        self.session = Session(
            Engine(EngineOptions(models=packaged_models())),
            Reception(self.stamper, [], self.clock, self.peers),
            GroundStation(self.alerts),
            recorder=self.recorder,
            sinks=[self.shown],
        )
        self._tick_us = start_us

    def hear(self, pieces: Iterable[Piece]) -> None:
        """Take pieces in blocks of a tenth of a second of their own time."""
        block: list[Piece] = []
        for piece in sorted(pieces, key=lambda piece: piece.time_us):
            if block and piece.time_us >= block[0].time_us + 100_000:
                self.wait_until(block[0].time_us + 100_000)
                self.session.take(block)
                block = []
            block.append(piece)
        if block:
            self.wait_until(block[-1].time_us)
            self.session.take(block)

    def wait_until(self, time_us: int) -> None:
        """Let time pass; the state is shown once a second."""
        while self._tick_us + 1_000_000 <= time_us:
            self._tick_us += 1_000_000
            self._move(self._tick_us)
            self.session.tick()
        self._move(time_us)

    def end(self) -> Assessment:
        """Close the session; its recording must give the same verdicts."""
        live = self.session.close()
        replayed = mavhums.analyse(self.recorder.path, mavhums.Options(key=self.key))
        assert json.dumps(verdicts(live)) == json.dumps(verdicts(replayed)), "byte for byte"
        assert replayed.log.losses.any is False
        return live

    def _move(self, time_us: int) -> None:
        step_us = max(time_us - self.now_us, 0)
        self.now_us += step_us
        self.wall_us += step_us


def verdicts(assessment: Assessment) -> Any:
    return json.loads(assessment.to_json())["verdicts"]


def of(assessment: Assessment, actuator: str, vehicle: int = 1) -> Verdict:
    return next(v for v in assessment.verdicts if (v.vehicle, v.actuator) == (vehicle, actuator))


def conditions(assessment: Assessment, vehicle: int = 1) -> dict[str, str]:
    return {v.actuator: v.condition for v in assessment.verdicts if v.vehicle == vehicle}


RIGHT = {"aileron_left": "normal", "aileron_right": "normal", "elevator": "emergency", "rudder": "normal"}


def pieces(record: FlightRecord, link: Link | None = None, sender: str = "vehicle") -> list[Piece]:
    """The flight as datagrams of one frame each."""
    frames = transmit(messages(record), link or Link(), 7)
    return [Piece(sender, frame.received_us, frame.data) for frame in frames]


@pytest.fixture(scope="session")
def worn() -> FlightRecord:
    """Thirty seconds in which the elevator is an emergency, at 50 Hz."""
    return fly(Flight(seed=31, duration_s=30.0, rate_hz=50.0, friction_nm={"elevator": (1.0, 1.0)}))


@pytest.fixture(scope="session")
def worn_pieces(worn: FlightRecord) -> list[Piece]:
    return pieces(worn)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


@pytest.fixture
def make_rig(tmp_path: Path) -> Callable[..., Rig]:
    return lambda **options: Rig(tmp_path, **options)
