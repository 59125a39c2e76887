"""Outputs of a session: JSON Lines, text, a table on the terminal, Rerun in a thread, for it may hang."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Final

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.core.about import NOTICE, __version__
from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import ConditionChanged, Window
from mavhums.live.alerts import fault_of
from mavhums.live.outlet import Outlet
from mavhums.live.session import LiveSink
from mavhums.live.status import SessionStatus, utc
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
from mavhums.show.blocks import Note
from mavhums.show.now import alert_line, change_line, status_blocks
from mavhums.show.terminal import parts
from mavhums.show.words import clock

if TYPE_CHECKING:
    from mavhums.show.viewer import LiveViewer

_SAMPLES: Final = 100_000
"""How many samples may wait: about a minute of an aircraft with 16 actuators at 100 Hz, 10 MB."""

_LATEST: Final = 5
_HINT: Final = "Ctrl-C ends and prints the verdicts"
_LINES: Final[dict[type, type[WindowObject | ConditionObject | NoticeObject]]] = {
    Window: WindowObject,
    ConditionChanged: ConditionObject,
    Notice: NoticeObject,
}


class DrawingSink(LiveSink):
    """Draws in a thread of its own, and drops what waits too long; a failure ends nothing else.

    Of alerts it draws nothing: the change was already drawn.

    Parameters
    ----------
    drawing
        An open viewer; from now on only the thread uses it.
    name
        Name in messages.
    release
        Called in the thread at the end.
    patience_s
        Maximum duration of the end.
    """

    def __init__(
        self, drawing: LiveViewer, name: str, release: Callable[[], object], *, patience_s: float
    ) -> None:
        self.outlet: Outlet[Callable[[], object]] = Outlet(name, self._draw, room=_SAMPLES)
        self._drawing, self._release, self._patience_s = drawing, release, patience_s

    def consume(self, events: Sequence[Event]) -> None:
        """Draw events."""
        samples = sum(event.time_s.size for event in events if isinstance(event, Samples))
        self.outlet.put(partial(self._drawing.consume, events), 1 + samples)

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Check whether the viewer still runs."""
        self.consume(())

    def close(self, assessment: Assessment) -> None:
        """Draw the verdicts."""
        self.outlet.put(partial(self._drawing.close, assessment))

    def finish(self) -> bool:
        """Release the drawing; return whether it was released within its time."""
        began_s = time.monotonic()
        self.outlet.put(self._release)
        return self.outlet.close(self._patience_s - (time.monotonic() - began_s))

    def _draw(self, draw: Callable[[], object]) -> None:
        draw()
        if trouble := self._drawing.trouble:
            raise RuntimeError(trouble)


class JsonLines(LiveSink):
    """Writes each event as an object of ``mavhums/results/schema/live-1.json``.

    Parameters
    ----------
    write
        Writes a line; it must flush it.
    now_us
        The present time, microseconds of UTC.
    status
        Status of the session, for the account at its end.
    """

    def __init__(
        self, write: Callable[[str], object], now_us: Callable[[], int], status: SessionStatus
    ) -> None:
        self._write, self._now_us, self._status = write, now_us, status

    def start(self, links: Sequence[str], *, airframe: str | None, signed_only: bool) -> None:
        """Write the description of the session."""
        record = self._status.record()
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

    def consume(self, events: Sequence[Event]) -> None:
        """Write events except samples."""
        now = utc(self._now_us())
        for event in events:
            if line := _object(event, now):
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
        end = EndObject(
            utc=utc(now_us),
            link=self._status.link(assessment, now_us),
            record=self._status.record(),
            outputs=self._status.outputs(),
            assessment=assessment,
        )
        self._put(end)

    def _put(self, line: LiveObject) -> None:
        self._write(line.model_dump_json(by_alias=True, exclude={"assessment": RECORD}))


class PlainLines(LiveSink):
    """Writes a line when a condition changes, which contains the alert, or an actuator stops reporting."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write

    def consume(self, events: Sequence[Event]) -> None:
        """Write changes of condition."""
        for event, text in _changes(events):
            self._write(
                f"{event.time_s:8.1f} s  vehicle {event.vehicle}, {text}, since {event.since_s:.1f} s"
            )

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Write which actuators stopped or resumed reporting."""
        for change in stale:
            state = f"stale, silent for {change.age_s:.1f} s" if change.stale else "received again"
            self._write(f"{status.uptime_s:8.1f} s  vehicle {change.vehicle}, {change.actuator}: {state}")


def _object(event: Event, now: str) -> LiveObject | None:
    """Return the line of an event, whose fields have the names of the event's."""
    if isinstance(event, AirframeNamed):
        name = event.airframe.name
        return AirframeObject(utc=now, time_s=event.time_s, vehicle=event.vehicle, airframe=name)
    kind = _LINES.get(type(event))
    if kind is None:
        return None
    values = {one.name: getattr(event, one.name) for one in fields(event) if one.name in kind.model_fields}
    if isinstance(event, Window):
        values["moving_fraction"] = round(event.moving_fraction, 4)
    elif isinstance(event, ConditionChanged):
        values["fault"] = fault_of(event)
    line: LiveObject = kind(utc=now, **values)
    return line


def _changes(events: Sequence[Event]) -> Iterator[tuple[ConditionChanged, str]]:
    """Yield each change of condition with its text."""
    for event in events:
        if isinstance(event, ConditionChanged):
            yield event, change_line(event.actuator, event.before, event.after, fault_of(event))


class View(LiveSink):
    """Shows verdicts, rates, losses and the age of the latest data.

    Parameters
    ----------
    console
        The terminal.
    title
        The links of the session.
    """

    def __init__(self, console: Console, title: str) -> None:
        self._title = title
        self._latest: deque[str] = deque(maxlen=_LATEST)
        self._live = Live(
            Text(f"{title}: waiting for a vehicle; Ctrl-C ends", style="dim"),
            console=console,
            auto_refresh=False,
            transient=True,
        )
        self._live.start()

    def consume(self, events: Sequence[Event]) -> None:
        """Remember the latest changes of condition."""
        for event, text in _changes(events):
            self._latest.append(f"{clock(event.time_s)}  {text}")

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Draw the state."""
        shown = [*status_blocks(status, self._title, [*self._latest]), Note([_HINT], quiet=True)]
        self._live.update(Group(*parts(shown, self._live.console.width)), refresh=True)

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Remember the alerts that were sent."""
        self._latest.extend(map(alert_line, alerts))

    def close(self, assessment: Assessment) -> None:
        """Remove the table; the verdicts are printed in its place."""
        self._live.stop()
