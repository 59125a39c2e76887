"""A live session: data from links in, verdicts out, until a stop request."""

from __future__ import annotations

import logging
import select
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

from mavhums.engine.axes import MOST_VEHICLES
from mavhums.engine.engine import Engine
from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import ConditionChanged
from mavhums.live.alerts import Alerts
from mavhums.live.links import Link
from mavhums.live.outlet import TlogRecorder
from mavhums.live.status import Reception, SessionStatus
from mavhums.log.mavlink.stamping import Piece
from mavhums.results.assessment import Assessment
from mavhums.results.live import AlertObject, StaleObject, StatusObject
from mavhums.results.reasons import Reason, said

T = TypeVar("T")
_LOG = logging.getLogger(__name__)
BLOCK_S = 0.1
"""How long pieces are collected before the engine takes them."""

_FAILED = "a step of the assessment failed; reception and recording go on"
_TICK_US = 1_000_000
_CALM_S, _BUSY_S = 0.05, 0.005
_MANY = 100
_CONTESTED_US = 60_000_000
_REMEMBER_EVERY = 10
_PENDING = 1 << 13
_DEFAULT_VEHICLE = 1  # ArduPilot's default system id, announced to before a vehicle is heard


class LiveSink:
    """A display or output of a session; what a kind of output does not need, it leaves out."""

    def consume(self, events: Sequence[Event]) -> None:
        """Take events as they come."""

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Take the state, once a second, and the actuators that stopped or resumed reporting."""

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Take the alerts that were sent to the ground station."""

    def close(self, assessment: Assessment) -> None:
        """Take the verdicts of the whole session."""


class GroundStation(NamedTuple):
    """What a session sends.

    Attributes
    ----------
    alerts
        Sends what is found; None for none.
    greeter
        Sends a heartbeat each second over the links; may be the same as ``alerts``; None for none.
    links
        Links that send alerts and receive nothing.
    """

    alerts: Alerts | None = None
    greeter: Alerts | None = None
    links: Sequence[Link] = ()


class Session:
    """Feeds an engine from links.

    The recorder and the engine receive the same accepted bytes from the stamper. So the verdicts
    are those of ``mavhums analyse`` on the recording.

    Parameters
    ----------
    engine
        A new engine. It needs no key: the stamper's guard has checked the signatures.
    reception
        What it receives by.
    ground
        What it sends.
    recorder
        Writes the accepted frames; None for none.
    sinks
        Take events, state and verdicts.
    compare
        Returns an assessment with the name of its aircraft, compared with its earlier flights; also called
        when a vehicle reports its board, so that the name is known.

    Examples
    --------
    >>> from mavhums.log.mavlink.dialect import load_dialect
    >>> from mavhums.log.mavlink.stamping import Stamper
    >>> session = Session(Engine(), Reception(Stamper(load_dialect())))
    >>> session.run(stop=lambda: True).verdicts[0].reason
    'nothing was received on any link'
    """

    def __init__(
        self,
        engine: Engine,
        reception: Reception,
        ground: GroundStation = GroundStation(),  # noqa: B008 — immutable
        *,
        recorder: TlogRecorder | None = None,
        sinks: Sequence[LiveSink] = (),
        compare: Callable[[Assessment], Assessment] | None = None,
    ) -> None:
        self.clock, self.links, self.peers = reception.clock, reception.links, reception.peers
        self.recorder, self.sinks = recorder, list(sinks)
        self.status = SessionStatus(reception, recorder)
        self.status.alert_links = [*self.links, *ground.links]
        self._contested: dict[int, int] = {}
        self._engine, self._stamper, self._remember = engine, reception.stamper, reception.remember
        self._alerts, self._greeter, self._ground = ground
        self._compare = compare
        self._identified: set[tuple[int, str | None]] = set()
        self._ticks = self._frames = 0
        self._busy = False
        self._latest_us = 0
        self._due_us = self.clock.now_us()
        self._first_us: int | None = None
        self._failures = 0
        self._latest = engine.assessment(indicators=False)

    def run(self, stop: Callable[[], bool]) -> Assessment:
        """Follow the links until ``stop`` returns true, and return the verdicts."""
        pending: list[Piece] = []
        try:
            while not stop():
                self._wait(pending)
                before = len(pending)
                for link in self.links:
                    pending += link.receive()
                self._busy = len(pending) - before > _MANY
                now_us = self.clock.now_us()
                old = pending and now_us - pending[0].time_us >= BLOCK_S * 1e6
                if old or len(pending) > _PENDING:
                    self.take(pending)
                    pending = []
                if now_us >= self._due_us:
                    self.tick()
            self.take(pending)
        finally:
            assessment = self.close()
        return assessment

    def take(self, pieces: list[Piece]) -> None:
        """Pass the records of received pieces to the recorder and the engine, and the events to all sinks."""
        pieces.sort(key=lambda piece: piece.time_us)
        if pieces and pieces[0].time_us < self._latest_us:
            pieces = [piece._replace(time_us=max(piece.time_us, self._latest_us)) for piece in pieces]
        if pieces:
            self._latest_us = pieces[-1].time_us
            self._record(self._stamper.feed(pieces))

    def tick(self) -> None:
        """Show the state; send the heartbeat and the actuators' health to the ground station."""
        now_us = self.clock.now_us()
        self._due_us = max(self._due_us + _TICK_US, now_us)
        self._latest = assessment = self._judged(
            lambda: self._engine.assessment(indicators=False), self._latest
        )
        self._note_boards(assessment)
        state, stale = self.status.report(assessment, now_us)
        self._ticks += 1
        self.peers.forget(now_us)
        self._warn_contested(state.link.contested, now_us)
        if self._remember and self._ticks % _REMEMBER_EVERY == 0:
            self._remember()
        # An autopilot sends named values, and much else, only where it has heard a HEARTBEAT.
        heard = self.peers.vehicles(now_us)[:MOST_VEHICLES] or [_DEFAULT_VEHICLE]
        for sender in filter(None, (self._greeter, self._alerts)):
            sender.mavlink2 = self._stamper.speaks_mavlink2 or not self._stamper.frames
        if self._greeter and self._greeter is not self._alerts:
            for vehicle in heard:
                self._greeter.heartbeat(vehicle, now_us)
        if self._alerts:
            announced = heard if self._greeter is self._alerts else ()
            self._announce(self._alerts.tick(state.actuators, now_us, announced))
        for change in stale:
            what = f"silent for {change.age_s:.1f} s" if change.stale else "received again"
            _LOG.info("vehicle %d, %s: %s", change.vehicle, change.actuator, what)
        for sink in self.sinks:
            sink.tick(state, stale)

    def close(self) -> Assessment:
        """Judge the remaining data, close recorder, links and sinks, and return the verdicts."""
        now_us = max(self.clock.now_us(), self._latest_us)
        self._record(self._stamper.close(now_us))
        self._publish(self._judged(self._engine.finish, []))
        if self.recorder:
            self.recorder.close()
        if self._remember:
            self._remember()
        path = str(self.recorder.path) if self.recorder else ", ".join(str(k.address) for k in self.links)
        assessment = self._judged(lambda: self._engine.assessment(path or None), self._latest)
        assessment = self._with_failures(self._with_reason(assessment))
        if self._compare:
            assessment = self._compare(assessment)
        for link in (*self.links, *self._ground):
            link.close()
        for sink in self.sinks:
            sink.close(assessment)
        return assessment

    def _note_boards(self, assessment: Assessment) -> None:
        """Identify the aircraft as soon as a vehicle reports its board."""
        identified = {(flight.vehicle, flight.board) for flight in assessment.log.flight}
        if self._compare and identified != self._identified:
            self._identified = identified
            self._compare(assessment)

    def _with_reason(self, assessment: Assessment) -> Assessment:
        """Return an assessment that says why no frame was accepted, if none was."""
        counts = self._stamper.counts
        if counts.frames:
            return assessment
        where = ", ".join(str(link.address) for link in self.links) or "any link"
        refused = counts.unsigned_frames + counts.bad_signatures + counts.replayed_frames
        code = "no_signed_frame" if refused else "no_frame"
        why = Reason(code if counts.bytes else "nothing_received", where=where, bytes=counts.bytes)
        verdicts = [v.model_copy(update=said(why)) for v in assessment.verdicts]
        return assessment.model_copy(update={"verdicts": tuple(verdicts)})

    def _record(self, records: bytes) -> None:
        """Pass records to the recorder and the engine."""
        if not records:
            return
        frames, self._frames = self._stamper.frames - self._frames, self._stamper.frames
        if self._first_us is None:
            self._first_us = int.from_bytes(records[:8], "big")
        if self.recorder:
            self.recorder.write(records, frames)
        nothing: list[Event] = []
        events = self._judged(lambda: self._engine.feed(records), nothing)
        self.status.observe(events, self.clock.now_us())
        self._publish(events)

    def _judged(self, judge: Callable[[], T], otherwise: T) -> T:
        """Return what a step of the assessment returns.

        Whatever a sender makes fail in it, reception, recording and the next step go on; it is counted, and
        shown at its first time.
        """
        try:
            return judge()
        except Exception:
            self._failures += 1
            if self._failures == 1:
                _LOG.exception("%s", _FAILED)
                for sink in self.sinks:
                    sink.consume(
                        [Notice((self._latest_us - (self._first_us or self._latest_us)) / 1e6, None, _FAILED)]
                    )
            return otherwise

    def _with_failures(self, assessment: Assessment) -> Assessment:
        """Return the assessment with the number of its steps that failed, if any."""
        if not self._failures:
            return assessment
        said = f"{_FAILED}: {self._failures} times; judge the recording again, and report it if it fails"
        return assessment.with_notice(said)

    def _publish(self, events: list[Event]) -> None:
        """Pass events to the alerts and the sinks."""
        for event in events:
            if isinstance(event, ConditionChanged):
                _LOG.info("%s: %s → %s: %s", event.actuator, event.before, event.after, event.rule)
            elif isinstance(event, Notice):
                _LOG.info("vehicle %s: %r", event.vehicle, event.text)
        for sink in self.sinks:
            sink.consume(events)
        if self._alerts:
            self._announce(self._alerts.observe(events, self.clock.now_us()))

    def _warn_contested(self, vehicles: Sequence[int], now_us: int) -> None:
        """Warn about vehicles with more than one sender, at most once a minute for each vehicle."""
        notices = []
        for vehicle in vehicles:
            if now_us - self._contested.get(vehicle, 0) >= _CONTESTED_US:
                self._contested[vehicle] = now_us
                text = f"more than one sender transmits as vehicle {vehicle}; its verdicts mix them"
                _LOG.warning("%s", text)
                time_s = (now_us - (self._first_us or now_us)) / 1e6
                notices.append(Notice(time_s, vehicle, text))
        if notices:
            for sink in self.sinks:
                sink.consume(notices)

    def _announce(self, alerts: Sequence[AlertObject]) -> None:
        for alert in alerts:
            _LOG.info("sent to the ground station: %s", alert.text)
        if alerts:
            for sink in self.sinks:
                sink.announce(alerts)

    def _wait(self, pending: Sequence[Piece]) -> None:
        """Wait until data arrive, or until pending work is due.

        If the kernel reports the times of reception, data may wait there for a while.
        """
        now_us = self.clock.now_us()
        due_us = pending[0].time_us + BLOCK_S * 1e6 if pending else now_us + BLOCK_S * 1e6
        wait_s = max(min(due_us, self._due_us) - now_us, 0) / 1e6
        readable = [descriptor for link in self.links if (descriptor := link.fileno()) >= 0]
        if pending or not readable:
            exact = all(link.stamped for link in self.links)
            time.sleep(min(wait_s, _BUSY_S if self._busy or not exact else _CALM_S))
        else:
            select.select(readable, [], [], wait_s)
