"""The state of a session: who sends for which vehicle, verdicts, ages, rates, and all losses."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

from mavhums.actuator.mapping import Samples
from mavhums.engine.events import Event
from mavhums.live.links import Link, ReceiveClock
from mavhums.live.outlet import Outlet, TlogRecorder
from mavhums.log.mavlink.stamping import Stamper
from mavhums.results.assessment import Assessment
from mavhums.results.live import (
    ActuatorStatus,
    LinkStatus,
    OutputStatus,
    RecordStatus,
    StaleObject,
    StatusObject,
)
from mavhums.results.verdict import ALL, Verdict

STALE_S = 3.0
"""Seconds without data after which an actuator is stale."""

_PEERS: Final = 64
_RECENT_US: Final = 10_000_000
_CREDIT: Final = 1 << 16
_GROUND: Final = 250  # ground stations choose system ids from here up: 255, 252, 250


@dataclass(slots=True)
class _Peer:
    """``credit``: number of bytes it may receive; ``latest_us``: time of its last frame, by vehicle."""

    credit: int = 0
    latest_us: dict[int, int] = field(default_factory=dict)


class Peers:
    """The peers that send for each vehicle over a link, at most 64: those that sent most.

    The address of a datagram can be forged. So a peer receives data only about vehicles that it sends
    for, never more bytes than it sent, and none after ten seconds of silence.
    """

    def __init__(self) -> None:
        self._peers: dict[Hashable, _Peer] = {}

    def __len__(self) -> int:
        return len(self._peers)

    def hear(self, sender: Hashable, vehicles: Iterable[int], size: int, time_us: int) -> None:
        """Note ``size`` bytes of accepted frames of these vehicles from a peer."""
        if sender not in self._peers and len(self._peers) >= 2 * _PEERS:
            self.forget(time_us)
        peer = self._peers.setdefault(sender, _Peer())
        peer.credit = min(peer.credit + size, _CREDIT)
        peer.latest_us |= dict.fromkeys(vehicles, time_us)

    def forget(self, now_us: int) -> None:
        """Forget silent peers and, if there are too many, those that sent least."""
        for peer in self._peers.values():
            peer.latest_us = {
                vehicle: latest for vehicle, latest in peer.latest_us.items() if latest >= now_us - _RECENT_US
            }
        kept = {sender: peer for sender, peer in self._peers.items() if peer.latest_us}
        most = sorted(kept, key=lambda sender: kept[sender].credit, reverse=True)[:_PEERS]
        self._peers = {sender: kept[sender] for sender in most}

    def senders_for(self, vehicle: int, now_us: int) -> list[Hashable]:
        """Return the peers that recently sent for a vehicle."""
        return self._senders(now_us)[vehicle]

    def vehicles(self, now_us: int) -> list[int]:
        """Return the vehicles that peers recently sent for, ground stations excluded."""
        return sorted(vehicle for vehicle in self._senders(now_us) if vehicle < _GROUND)

    def afford(self, sender: Hashable, size: int) -> bool:
        """Return whether a peer may receive this many bytes, and count them."""
        peer = self._peers.get(sender)
        if peer is None or peer.credit < size:
            return False
        peer.credit -= size
        return True

    def contested(self, now_us: int) -> list[int]:
        """Return the vehicles for which more than one peer recently sent."""
        return sorted(vehicle for vehicle, senders in self._senders(now_us).items() if len(senders) > 1)

    def _senders(self, now_us: int) -> defaultdict[int, list[Hashable]]:
        """Return the peers that recently sent, by vehicle."""
        senders: defaultdict[int, list[Hashable]] = defaultdict(list)
        for sender, peer in self._peers.items():
            for vehicle, latest_us in peer.latest_us.items():
                if latest_us >= now_us - _RECENT_US:
                    senders[vehicle].append(sender)
        return senders


@dataclass(slots=True)
class Reception:
    """What a session receives by.

    Attributes
    ----------
    stamper
        Makes records of the received data.
    links
        Links to receive from.
    clock
        Clock of reception.
    peers
        The senders on the links; the stamper updates them.
    remember
        Called now and then and at the end, to store data for the next session; None for nothing.
    """

    stamper: Stamper
    links: Sequence[Link] = ()
    clock: ReceiveClock = field(default_factory=ReceiveClock)
    peers: Peers = field(default_factory=Peers)
    remember: Callable[[], None] | None = None


@dataclass(slots=True)
class _Activity:
    """The number of samples of an actuator since the last report, and the time of the latest."""

    latest_us: int
    samples: int = 0
    stale: bool = False


class SessionStatus:
    """Keeps the time of the latest data of each actuator, for at most as many as the profile has.

    An axis is as old as the latest data of any link.

    Parameters
    ----------
    reception
        What the session receives by; its clock gives the start of the session.
    recorder
        Recorder of the session; None for none.

    Attributes
    ----------
    outlets
        Outputs whose losses are reported.
    alert_links
        Links that send alerts.
    """

    def __init__(self, reception: Reception, recorder: TlogRecorder | None) -> None:
        self.outlets: list[Outlet[Any]] = []
        self.alert_links: Sequence[Link] = reception.links
        self._reception, self._recorder = reception, recorder
        self._start_us = self._reported_us = reception.clock.now_us()
        self._activity: dict[tuple[int, str], _Activity] = {}
        self._latest_us: int | None = None
        self._frames = self._bytes = 0

    def observe(self, events: Iterable[Event], now_us: int) -> None:
        """Note which actuators reported."""
        self._latest_us = now_us
        for event in events:
            if isinstance(event, Samples):
                activity = self._activity.setdefault((event.vehicle, event.actuator), _Activity(now_us))
                activity.latest_us = now_us
                activity.samples += event.time_s.size

    def report(self, assessment: Assessment, now_us: int) -> tuple[StatusObject, list[StaleObject]]:
        """Return the present state, and which actuators stopped or resumed reporting since the last call."""
        elapsed_s = max((now_us - self._reported_us) / 1e6, 1e-3)
        changes = []
        for (vehicle, actuator), activity in self._activity.items():
            age_s = (now_us - activity.latest_us) / 1e6
            if activity.stale != (age_s > STALE_S):
                activity.stale = not activity.stale
                change = StaleObject(
                    utc=utc(now_us),
                    vehicle=vehicle,
                    actuator=actuator,
                    stale=activity.stale,
                    age_s=round(age_s, 3),
                )
                changes.append(change)
        verdicts = [verdict for verdict in assessment.verdicts if verdict.vehicle]
        status = StatusObject(
            utc=utc(now_us),
            uptime_s=round((now_us - self._start_us) / 1e6, 3),
            actuators=tuple(self._actuator(verdict, now_us, elapsed_s) for verdict in verdicts),
            link=self.link(assessment, now_us, elapsed_s),
            record=self.record(),
            outputs=self.outputs(),
        )
        for activity in self._activity.values():
            activity.samples = 0
        self._reported_us = now_us
        return status, changes

    def link(self, assessment: Assessment, now_us: int, elapsed_s: float = 1.0) -> LinkStatus:
        """Return the account of the links, with rates since the last call."""
        counts = asdict(self._reception.stamper.counts)
        datagrams, sequence = counts.pop("pieces"), assessment.log.losses.sequence
        frames, self._frames = counts["frames"] - self._frames, counts["frames"]
        octets, self._bytes = counts["bytes"] - self._bytes, counts["bytes"]
        return LinkStatus(
            age_s=_age_s(self._latest_us, now_us),
            frames_per_s=round(frames / elapsed_s, 1),
            bytes_per_s=round(octets / elapsed_s, 1),
            datagrams=datagrams,
            missing_frames=sum(loss.missing for loss in sequence),
            reordered_frames=sum(loss.reordered for loss in sequence),
            duplicated_frames=sum(loss.duplicated for loss in sequence),
            dropped_datagrams=sum(link.dropped for link in self._reception.links),
            contested=tuple(self._reception.peers.contested(now_us)),
            **counts,
        )

    def outputs(self) -> tuple[OutputStatus, ...]:
        """Return the outputs that dropped items."""
        lossy = [
            OutputStatus(name=o.name, dropped=o.dropped, error=o.error) for o in self.outlets if o.dropped
        ]
        unsent = [
            OutputStatus(name=f"alerts to {link.address}", dropped=link.unsent, error=None)
            for link in self.alert_links
            if link.unsent
        ]
        return (*lossy, *unsent)

    def record(self) -> RecordStatus | None:
        """Return the state of the recording."""
        recorder = self._recorder
        if recorder is None:
            return None
        return RecordStatus(
            path=str(recorder.path),
            bytes=recorder.bytes,
            lost_frames=recorder.lost_frames,
            error=recorder.error,
        )

    def _actuator(self, verdict: Verdict, now_us: int, elapsed_s: float) -> ActuatorStatus:
        activity = self._activity.get((verdict.vehicle or 0, verdict.actuator))
        if activity:
            stale = activity.stale
        else:
            silent = self._latest_us is None or (now_us - self._latest_us) / 1e6 > STALE_S
            stale = silent and (verdict.actuator == ALL or verdict.subject != "actuator")
        latest_us = activity.latest_us if activity else None
        if verdict.subject != "actuator":
            latest_us = self._latest_us
        return ActuatorStatus(
            vehicle=verdict.vehicle,
            actuator=verdict.actuator,
            condition="undecided" if stale else verdict.condition,
            held=verdict.condition,
            worst=verdict.worst,
            stale=stale,
            age_s=_age_s(latest_us, now_us),
            rate_hz=0.0 if activity is None else round(activity.samples / elapsed_s, 1),
            friction_nm=verdict.friction_nm,
            network=verdict.network.latest if verdict.network else None,
            probability=verdict.network.probability if verdict.network else None,
            suspects=verdict.suspects,
            tier=verdict.tier,
            late=verdict.coverage.late,
            reason=verdict.reason,
        )


def _age_s(latest_us: int | None, now_us: int) -> float | None:
    return None if latest_us is None else round((now_us - latest_us) / 1e6, 3)


def utc(time_us: int) -> str:
    """Return a time in microseconds as ISO 8601.

    Examples
    --------
    >>> utc(1_767_258_000_000_000)
    '2026-01-01T09:00:00+00:00'
    """
    return datetime.fromtimestamp(time_us / 1e6, tz=UTC).isoformat()
