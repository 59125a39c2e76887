"""Builds a session from the user's options, and runs it."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole
from mavhums.engine.engine import Engine
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.aircraft import AircraftResolver
from mavhums.live.alerts import COMPONENT, Alerts, Signer
from mavhums.live.links import Address, Link, ReceiveClock, UdpLink
from mavhums.live.outlet import TlogRecorder
from mavhums.live.session import GroundStation, LiveSink, Session
from mavhums.live.status import Peers, Reception
from mavhums.live.streams import SerialLink, TcpLink
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.signing import SignatureGuard
from mavhums.log.mavlink.stamping import Stamper

if TYPE_CHECKING:
    from mavhums.flights.store import Store
    from mavhums.results.assessment import Assessment

_LOG = logging.getLogger(__name__)
_HEADERS = 28  # bytes of a datagram's IPv4 and UDP headers

_LINKS: Final[dict[str, Callable[[Address, ReceiveClock], Link]]] = {
    "udpin": UdpLink,
    "udpout": UdpLink,
    "tcp": TcpLink,
    "serial": SerialLink,
}
Stream = tuple[int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """The options of ``mavhums live``.

    Attributes
    ----------
    urls
        Addresses of the links.
    judging
        By what the links are judged. Their signatures are checked before the engine; the newest ones are
        stored beside the key, if that is a file.
    record
        The .tlog to write; None for none.
    alerts
        Whether alerts are sent to the ground station over the links.
    alerts_to
        Address to which alerts are sent instead.
    component
        Component id of the sender of alerts and heartbeats.
    silent
        Whether nothing but alerts is sent; without a HEARTBEAT many vehicles send less, or nothing.
    """

    urls: Sequence[str]
    judging: Options = field(default_factory=Options)
    record: Path | None = None
    alerts: bool = False
    alerts_to: str | None = None
    component: int = COMPONENT
    silent: bool = False


def prepare(options: LiveOptions, sinks: Sequence[LiveSink] = (), *, vehicle_states: bool = False) -> Session:
    """Return a session that already listens; ``vehicle_states`` as in :class:`mavhums.Engine`.

    Raises
    ------
    MavhumsError
        If an address, a profile, a dialect, a model, a key, a store or the recording cannot be used.
    """
    addresses = [Address.parse(url) for url in options.urls]
    ground = [Address.parse(options.alerts_to)] if options.alerts_to else []
    settings = Settings.read(options.judging)
    key, file = settings.engine.key, options.judging.key
    seen = SeenSignatures(Path(file)) if isinstance(file, str | os.PathLike) else None
    guard = SignatureGuard(key, before=seen.load() if seen else None) if key else None
    engine = replace(settings.engine, key=None, vehicle_states=vehicle_states)
    judging = Engine(engine)
    flown = None if settings.store is None else _LinkFlights(settings.store, judging, settings.resolver)
    recorder = TlogRecorder(options.record) if options.record else None
    clock, peers = ReceiveClock(), Peers()
    links = _open(addresses, clock, signed_only=key is not None)
    ground_links = _open(ground, clock, signed_only=key is not None) if ground else links
    stamper = Stamper(load_dialect(Path(engine.dialect) if engine.dialect else None), guard, hear=peers.hear)
    reception = Reception(stamper, links, clock, peers)
    if seen and guard:
        reception.remember = lambda: seen.save(guard.latest)

    def voice(to: Sequence[Link]) -> Alerts:
        return Alerts(
            partial(_send, reception, to),
            component=options.component,
            signer=Signer(key, lambda: guard.newest if guard else 0) if key else None,
            start_us=clock.now_us(),
        )

    alerts = voice(ground_links) if options.alerts or ground else None
    greeter = None if options.silent else alerts if alerts and not ground else voice(links)
    return Session(
        judging,
        reception,
        GroundStation(alerts, greeter, ground_links if ground else ()),
        recorder=recorder,
        sinks=sinks,
        compare=flown.compared if flown else settings.resolver.named,
    )


def _send(reception: Reception, to: Sequence[Link], frame: bytes, vehicle: int) -> None:
    """Send a frame about a vehicle to the peers that speak for it, as far as they may receive."""
    heard: list[Hashable] = []
    if any(link.address.kind == "udpin" for link in to):
        peers = reception.peers
        speaking = peers.senders_for(vehicle, reception.clock.now_us())
        heard = [peer for peer in speaking if peers.afford(peer, len(frame) + _HEADERS)]
    for link in to:
        link.send(frame, heard)


class _LinkFlights:
    """The earlier flights of the aircraft at a link, which its board may name in flight."""

    def __init__(self, store: Store, engine: Engine, given: AircraftResolver) -> None:
        from mavhums.flights.landing import OwnFlights  # a session without a store needs no database

        self._engine, self._look_up = engine, partial(OwnFlights, store, given=given)
        self._own = self._look_up(engine.assessment(indicators=False))

    def compared(self, assessment: Assessment) -> Assessment:
        """Return an assessment with the name of its aircraft, compared with its earlier flights."""
        if not self._own.is_named:
            self._own = self._look_up(assessment)
        engine = self._engine
        alone = StandaloneAssessment(assessment, engine.profiles(), engine.options.false_alarms)
        return self._own.compared(alone)


def _open(addresses: Sequence[Address], clock: ReceiveClock, *, signed_only: bool) -> list[Link]:
    links: list[Link] = []
    try:
        for address in addresses:
            links.append(_LINKS[address.kind](address, clock))
            if address.exposed:
                trust = "" if signed_only else ", without authentication; --key accepts only signed frames"
                _LOG.warning("%s: other computers can send here, too%s", address, trust)
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


class SeenSignatures:
    """Keeps the accepted time stamps between sessions, so that a replayed recording is never accepted as new.

    Parameters
    ----------
    key
        File of the key; the time stamps are stored beside it, as ``KEY.seen``.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(f"{key.name}.seen")
        self._saved: dict[Stream, int] = {}
        self._complained = False

    def load(self) -> dict[Stream, int]:
        """Return the newest time stamp by link, system and component; empty if none is stored."""
        try:
            kept = json.loads(self._path.read_text(encoding="ascii"))
            self._saved = {_stream(name): int(ticks) for name, ticks in kept.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, AttributeError, TypeError) as error:
            _LOG.warning("%s: %s; replays of former sessions cannot be recognised", self._path, error)
            return {}
        return dict(self._saved)

    def save(self, latest: Mapping[Stream, int]) -> None:
        """Store the newest time stamps."""
        if latest == self._saved:
            return
        try:
            with written_whole(self._path) as temporary:
                kept = {"/".join(map(str, stream)): ticks for stream, ticks in latest.items()}
                temporary.write_text(json.dumps(kept), encoding="ascii")
            self._saved = dict(latest)
        except MavhumsError as error:
            if not self._complained:
                _LOG.warning("%s; a replay of this session will not be recognised by the next", error)
            self._complained = True


def _stream(name: str) -> Stream:
    link, system, component = map(int, name.split("/"))
    return link, system, component
