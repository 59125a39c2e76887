"""Builds a session from the user's options, and runs it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from mavhums.actuator.profile import load_airframe
from mavhums.app import options as judging
from mavhums.app.own_flights import among_own
from mavhums.core.quantities import KEYS
from mavhums.engine.engine import Engine
from mavhums.engine.options import EngineOptions
from mavhums.health.actuator.monitor import Monitor
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.history.aircraft import latest
from mavhums.history.belonging import hold_one_aircraft, swaps_of
from mavhums.live.address import Address
from mavhums.live.alerts import COMPONENT, Alerts
from mavhums.live.clock import ReceiveClock
from mavhums.live.links import Link, open_link
from mavhums.live.peers import Peers
from mavhums.live.recorder import TlogRecorder
from mavhums.live.seen import Seen
from mavhums.live.session import Session, Sink
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.signing import SignatureGuard, load_key
from mavhums.log.mavlink.stamping import Piece, Stamper
from mavhums.report.assessment import Decide

__all__ = ["Options", "prepare"]

_LOG = logging.getLogger(__name__)
_UNKNOWN_VEHICLE = 1
_HEADERS = 28  # bytes of a datagram's IPv4 and UDP headers
_SERVO_OUTPUT_RAW = bytes.fromhex("fe150001012401000000dc05dc05dc05dc050000000000000000007188")


@dataclass(frozen=True, slots=True)
class Options:
    """The options of ``mavhums live``, under the same names.

    Raises
    ------
    AddressError
        If a URL has none of the accepted forms.
    """

    urls: Sequence[str]
    airframe: str | None = None
    model: str | None = None
    decide: Decide = "physics"
    dialect: Path | None = None
    false_alarms: float = FALSE_ALARMS
    history: judging.History | Path | None = None
    aircraft_table: Path | None = None
    dates: Sequence[tuple[str | None, datetime]] = ()
    key: Path | None = None
    record: Path | None = None
    alerts: bool = False
    alerts_to: str | None = None
    component: int = COMPONENT

    @property
    def judging(self) -> judging.Options:
        """The options by which the links are judged; signatures are checked before the engine."""
        return judging.Options(
            airframe=self.airframe,
            model=self.model,
            decide=self.decide,
            history=self.history,
            aircraft_table=self.aircraft_table,
            since=dict(self.dates),
            false_alarms=self.false_alarms,
            dialect=self.dialect,
        )

    def __post_init__(self) -> None:
        for url in (*self.urls, *filter(None, [self.alerts_to])):
            Address.parse(url)


def prepare(options: Options, sinks: Sequence[Sink] = (), *, vehicle_states: bool = False) -> Session:
    """Return a session that already listens; ``vehicle_states`` as in :class:`mavhums.Engine`.

    Raises
    ------
    MavhumsError
        If an address, a profile, a dialect, a model, a key, a history or the recording cannot be used.
    """
    addresses = [Address.parse(url) for url in options.urls]
    ground = [Address.parse(options.alerts_to)] if options.alerts_to else []
    key = load_key(options.key) if options.key else None
    owned = _owned(options.judging)
    judged_by = replace(owned, vehicle_states=vehicle_states).resolved()
    seen = Seen(options.key) if options.key else None
    guard = SignatureGuard(key, before=seen.load()) if key and seen else None
    _warm_up(judged_by)
    recorder = TlogRecorder(options.record) if options.record else None
    clock = ReceiveClock()
    links = _open(addresses, clock, signed_only=key is not None)
    ground_links = _open(ground, clock, signed_only=key is not None) if ground else links
    peers = Peers()
    stamper = Stamper(load_dialect(options.dialect), guard, hear=peers.hear)

    def voice(to: Sequence[Link], unknown: int | None) -> Alerts:
        def send(frame: bytes, vehicle: int) -> None:
            heard = []
            if any(link.address.kind == "udpin" for link in to):
                speaking = peers.speaking_for(vehicle, clock.now_us())
                heard = [peer for peer in speaking if peers.afford(peer, len(frame) + _HEADERS)]
            for link in to:
                link.send(frame, heard)

        return Alerts(
            send,
            component=options.component,
            key=key,
            newest_ticks=lambda: guard.newest if guard else 0,
            start_us=clock.now_us(),
            unknown=unknown,
        )

    callers = [link for link in links if link.address.kind == "udpout"]
    speaks = options.alerts or bool(ground)
    alerts = voice(ground_links, _UNKNOWN_VEHICLE if callers and not ground else None) if speaks else None
    greeter = voice(callers, None) if callers and (ground or not speaks) else None
    return Session(
        Engine(judged_by),
        stamper,
        links,
        recorder=recorder,
        alerts=alerts,
        greet=(lambda now_us: greeter.heartbeat(_UNKNOWN_VEHICLE, now_us)) if greeter else None,
        remember=(lambda: seen.save(guard.latest)) if seen and guard else None,
        sinks=sinks,
        clock=clock,
        peers=peers,
        ground=ground_links if ground else (),
        own=partial(among_own, options=owned),
    )


def _owned(options: judging.Options) -> judging.Options:
    """Return the options with the history and the table read, if the history is of one aircraft."""
    history, table = options.flights(), options.whose().table
    for error in history.errors:
        _LOG.warning("%s", error)
    hold_one_aircraft(history, table)
    since = latest(options.since, swaps_of(history, table, datetime.now(UTC)))
    return replace(options, history=history, aircraft_table=table, since=since)


def _open(addresses: Sequence[Address], clock: ReceiveClock, *, signed_only: bool) -> list[Link]:
    links: list[Link] = []
    try:
        for address in addresses:
            links.append(open_link(address, clock))
            if address.exposed:
                trust = "" if signed_only else ", and nothing tells who; --key accepts only signed frames"
                _LOG.warning("%s: not only this computer can send here%s", address, trust)
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def _warm_up(options: EngineOptions) -> None:
    """Compile the loops before the session, so that no data are lost during compilation."""
    dialect = None if options.dialect is None else Path(options.dialect)
    stamper, airframe = Stamper(load_dialect(dialect)), load_airframe("paper")
    records = stamper.feed([Piece(None, 0, _SERVO_OUTPUT_RAW)])
    engine = Engine(EngineOptions(airframe, options.models, dialect=dialect))
    engine.feed(records)
    engine.finish()
    samples = np.arange(0.0, 20.0, 0.1)
    list(Monitor(0, airframe.actuators[0]).feed(samples, np.zeros((samples.size, len(KEYS)))))
    for model in options.models:
        model.votes(np.zeros((1, len(KEYS))))
