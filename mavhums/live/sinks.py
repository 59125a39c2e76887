"""Where a session goes: JSON Lines, text, a Rerun viewer or recording; a thread before what may hang."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from mavhums.core.about import NOTICE, __version__
from mavhums.engine.events import AirframeNamed, ConditionChanged, Event, Notice, Samples, Window
from mavhums.live.outlet import Outlet
from mavhums.live.session import Sink
from mavhums.live.watch import Watch, utc
from mavhums.results.assessment import RECORD, Assessment
from mavhums.results.live import (
    AirframeObject,
    AlertObject,
    ConditionObject,
    EndObject,
    LiveObject,
    NoticeObject,
    StaleObject,
    StartObject,
    StatusObject,
    WindowObject,
)

if TYPE_CHECKING:
    from mavhums.show.live import LiveViewer
    from mavhums.show.recording import Recorder

__all__ = ["JsonLines", "PlainLines", "RerunSink", "ThreadedSink"]

_LOG = logging.getLogger(__name__)
_SAMPLES: Final = 100_000
"""How many samples may wait: about a minute of an aircraft with 16 actuators at 100 Hz, 10 MB."""

Faults = dict[tuple[int, str], str]


class ThreadedSink:
    """Passes everything to a sink in its own thread; drops items that wait too long.

    Parameters
    ----------
    sink
        The sink; from now on only the thread uses it.
    name
        Name in messages.
    release
        Called in the thread at the end.
    patience_s
        Maximum duration of the end.
    """

    def __init__(
        self, sink: Sink, name: str, release: Callable[[], object], *, patience_s: float = 1.0
    ) -> None:
        self.outlet: Outlet[Callable[[], object]] = Outlet(name, lambda call: call(), room=_SAMPLES)
        self._sink, self._release, self._patience_s = sink, release, patience_s

    def consume(self, events: Sequence[Event], faults: Faults) -> None:
        """Pass events to the sink."""
        samples = sum(event.time_s.size for event in events if isinstance(event, Samples))
        self.outlet.put(partial(self._sink.consume, events, faults), 1 + samples)

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Pass the state to the sink."""
        self.outlet.put(partial(self._sink.tick, status, stale))

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Pass the alerts that were sent to the sink."""
        self.outlet.put(partial(self._sink.announce, alerts))

    def close(self, assessment: Assessment) -> None:
        """Pass the verdicts to the sink."""
        self.outlet.put(partial(self._sink.close, assessment))

    def finish(self) -> bool:
        """Release the sink; return whether it was released within its time."""
        began_s = time.monotonic()
        self.outlet.put(self._release)
        return self.outlet.close(self._patience_s - (time.monotonic() - began_s))


class RerunSink:
    """Passes events to a viewer or a recorder until it fails; the failure is reported once, and ends nothing.

    Parameters
    ----------
    drawing
        An open drawing; its owner closes it.
    """

    def __init__(self, drawing: LiveViewer | Recorder) -> None:
        self._drawing = drawing
        self._failed = False

    def consume(self, events: Sequence[Event], faults: Faults) -> None:
        """Draw events."""
        self._try(lambda: self._drawing.consume(events))

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Check whether the viewer still runs."""
        trouble: str | None = getattr(self._drawing, "trouble", None)  # a recording has none
        if trouble and not self._failed:
            self._failed = True
            _LOG.error("%s", trouble)

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Draw nothing: the change was already drawn."""

    def close(self, assessment: Assessment) -> None:
        """Draw the verdicts."""
        self._try(lambda: self._drawing.close(assessment))

    def _try(self, draw: Callable[[], object]) -> None:
        try:
            draw()
        except Exception as error:
            if not self._failed:
                self._failed = True
                _LOG.error("nothing is drawn any more: %s", error, exc_info=_LOG.isEnabledFor(logging.DEBUG))


class JsonLines:
    """Writes each event as an object of ``mavhums/results/schema/live-1.json``.

    Parameters
    ----------
    write
        Writes a line; it must flush it.
    now_us
        The present time, microseconds of UTC.
    watch
        Watch of the session, for the account at its end.
    """

    def __init__(self, write: Callable[[str], object], now_us: Callable[[], int], watch: Watch) -> None:
        self._write, self._now_us, self._watch = write, now_us, watch

    def start(self, links: Sequence[str], *, airframe: str | None, signed_only: bool) -> None:
        """Write the description of the session."""
        record = self._watch.record()
        self._put(
            StartObject(
                utc=utc(self._now_us()),
                notice=NOTICE,
                version=__version__,
                links=tuple(links),
                airframe=airframe,
                record=record.path if record else None,
                signed_only=signed_only,
            )
        )

    def consume(self, events: Sequence[Event], faults: Faults) -> None:
        """Write events except samples."""
        now = utc(self._now_us())
        for event in events:
            line = _object(event, faults, now)
            if line is not None:
                self._put(line)

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Write the state."""
        for change in stale:
            self._put(change)
        self._put(status)

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Write the alerts that were sent."""
        for alert in alerts:
            self._put(alert)

    def close(self, assessment: Assessment) -> None:
        """Write the verdicts."""
        now_us = self._now_us()
        link, record = self._watch.link(assessment, now_us), self._watch.record()
        self._put(
            EndObject(
                utc=utc(now_us),
                link=link,
                record=record,
                outputs=self._watch.outputs(),
                assessment=assessment,
            )
        )

    def _put(self, line: LiveObject) -> None:
        self._write(line.model_dump_json(by_alias=True, exclude={"assessment": RECORD}))


class PlainLines:
    """Writes a line when a condition changes or an actuator stops reporting."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write

    def consume(self, events: Sequence[Event], faults: Faults) -> None:
        """Write changes of condition."""
        for event in events:
            if isinstance(event, ConditionChanged):
                fault = faults.get((event.vehicle, event.actuator))
                why = f" ({fault})" if fault else ""
                self._write(
                    f"{event.time_s:8.1f} s  vehicle {event.vehicle}, {event.actuator}: "
                    f"{event.before} → {event.after}{why}, since {event.since_s:.1f} s"
                )

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Write which actuators stopped or resumed reporting."""
        for change in stale:
            state = f"stale, silent for {change.age_s:.1f} s" if change.stale else "heard again"
            self._write(f"{status.uptime_s:8.1f} s  vehicle {change.vehicle}, {change.actuator}: {state}")

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Write nothing: the line of the change contains the alert."""

    def close(self, assessment: Assessment) -> None:
        """Write nothing: the verdicts are printed at the end."""


def _object(event: Event, faults: Faults, now: str) -> LiveObject | None:
    if isinstance(event, Window):
        return WindowObject(
            utc=now,
            vehicle=event.vehicle,
            actuator=event.actuator,
            start_s=event.start_s,
            end_s=event.end_s,
            moving_fraction=round(event.moving_fraction, 4),
            friction_nm=event.friction_nm,
            p_emergency=event.p_emergency,
            condition=event.condition,
        )
    if isinstance(event, ConditionChanged):
        return ConditionObject(
            utc=now,
            vehicle=event.vehicle,
            actuator=event.actuator,
            time_s=event.time_s,
            since_s=event.since_s,
            before=event.before,
            after=event.after,
            fault=faults.get((event.vehicle, event.actuator)),
            rule=event.rule,
        )
    if isinstance(event, AirframeNamed):
        name = event.airframe.name
        return AirframeObject(utc=now, time_s=event.time_s, vehicle=event.vehicle, airframe=name)
    if isinstance(event, Notice):
        return NoticeObject(utc=now, time_s=event.time_s, vehicle=event.vehicle, text=event.text)
    return None
