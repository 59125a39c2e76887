"""The state of a session once a second: verdicts, ages, rates, and all losses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

from mavhums.engine.events import Event, Samples
from mavhums.live.links import Link
from mavhums.live.outlet import Outlet
from mavhums.live.peers import Peers
from mavhums.live.recorder import TlogRecorder
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

__all__ = ["STALE_S", "Watch", "utc"]

STALE_S = 3.0
"""Seconds without data after which an actuator is stale."""

Key = tuple[int, str]


@dataclass(slots=True)
class _Heard:
    """The number of samples of an actuator since the last update, and the time of the latest."""

    latest_us: int
    samples: int = 0
    stale: bool = False


class Watch:
    """Keeps the time of the latest data of each actuator, for at most as many as the profile has.

    An axis is as old as the latest data of any link.

    Parameters
    ----------
    stamper, links, recorder
        The objects to watch.
    start_us
        Start of the session, microseconds of UTC.
    peers
        The senders on the links.

    Attributes
    ----------
    outlets
        Outputs whose losses are reported.
    alert_links
        Links that send alerts.
    """

    def __init__(
        self,
        stamper: Stamper,
        links: Sequence[Link],
        recorder: TlogRecorder | None,
        start_us: int,
        peers: Peers | None = None,
    ) -> None:
        self.outlets: list[Outlet[Any]] = []
        self.alert_links: Sequence[Link] = links
        self._peers = Peers() if peers is None else peers
        self._stamper, self._links, self._recorder = stamper, links, recorder
        self._start_us = self._looked_us = start_us
        self._heard: dict[Key, _Heard] = {}
        self._latest_us: int | None = None
        self._frames = self._bytes = 0

    def take(self, events: Iterable[Event], now_us: int) -> None:
        """Note which actuators reported."""
        self._latest_us = now_us
        for event in events:
            if isinstance(event, Samples):
                heard = self._heard.setdefault((event.vehicle, event.actuator), _Heard(now_us))
                heard.latest_us = now_us
                heard.samples += event.time_s.size

    def look(self, assessment: Assessment, now_us: int) -> tuple[StatusObject, list[StaleObject]]:
        """Return the present state, and which actuators stopped or resumed reporting since the last call."""
        elapsed_s = max((now_us - self._looked_us) / 1e6, 1e-3)
        changes = [
            StaleObject(
                utc=utc(now_us),
                vehicle=vehicle,
                actuator=actuator,
                stale=heard.stale,
                age_s=round(age_s, 3),
            )
            for (vehicle, actuator), heard in self._heard.items()
            if self._ages(heard, age_s := (now_us - heard.latest_us) / 1e6)
        ]
        verdicts = [verdict for verdict in assessment.verdicts if verdict.vehicle]
        status = StatusObject(
            utc=utc(now_us),
            uptime_s=round((now_us - self._start_us) / 1e6, 3),
            actuators=tuple(self._actuator(verdict, now_us, elapsed_s) for verdict in verdicts),
            link=self.link(assessment, now_us, elapsed_s),
            record=self.record(),
            outputs=self.outputs(),
        )
        for heard in self._heard.values():
            heard.samples = 0
        self._looked_us = now_us
        return status, changes

    def link(self, assessment: Assessment, now_us: int, elapsed_s: float = 1.0) -> LinkStatus:
        """Return the account of the links, with rates since the last call."""
        counts = asdict(self._stamper.counts)
        datagrams, sequence = counts.pop("pieces"), assessment.log.losses.sequence
        frames, self._frames = counts["frames"] - self._frames, counts["frames"]
        octets, self._bytes = counts["bytes"] - self._bytes, counts["bytes"]
        return LinkStatus(
            age_s=None if self._latest_us is None else round((now_us - self._latest_us) / 1e6, 3),
            frames_per_s=round(frames / elapsed_s, 1),
            bytes_per_s=round(octets / elapsed_s, 1),
            datagrams=datagrams,
            missing_frames=sum(loss.missing for loss in sequence),
            reordered_frames=sum(loss.reordered for loss in sequence),
            duplicated_frames=sum(loss.duplicated for loss in sequence),
            dropped_datagrams=sum(link.dropped for link in self._links),
            contested=tuple(self._peers.contested(now_us)),
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

    def _ages(self, heard: _Heard, age_s: float) -> bool:
        """Set whether an actuator is stale, and return whether that changed."""
        stale = age_s > STALE_S
        changed = stale != heard.stale
        heard.stale = stale
        return changed

    def _actuator(self, verdict: Verdict, now_us: int, elapsed_s: float) -> ActuatorStatus:
        heard = self._heard.get((verdict.vehicle or 0, verdict.actuator))
        silent = self._latest_us is None or (now_us - self._latest_us) / 1e6 > STALE_S
        stale = (
            heard.stale if heard else silent and (verdict.actuator == ALL or verdict.subject != "actuator")
        )
        latest_us = heard.latest_us if heard else None
        if verdict.subject != "actuator":
            latest_us = self._latest_us
        return ActuatorStatus(
            vehicle=verdict.vehicle,
            actuator=verdict.actuator,
            condition="undecided" if stale else verdict.condition,
            held=verdict.condition,
            worst=verdict.worst,
            stale=stale,
            age_s=None if latest_us is None else round((now_us - latest_us) / 1e6, 3),
            rate_hz=0.0 if heard is None else round(heard.samples / elapsed_s, 1),
            friction_nm=verdict.friction_nm,
            p_emergency=verdict.network.p_emergency if verdict.network else None,
            suspects=verdict.suspects,
            tier=verdict.tier,
            late=verdict.coverage.late,
            reason=verdict.reason,
        )


def utc(time_us: int) -> str:
    """Return a time in microseconds as ISO 8601.

    Examples
    --------
    >>> utc(1_767_258_000_000_000)
    '2026-01-01T09:00:00+00:00'
    """
    return datetime.fromtimestamp(time_us / 1e6, tz=UTC).isoformat()
