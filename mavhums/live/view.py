"""Shows the session on a terminal, as a table in place that is redrawn each second."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rich import box
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mavhums.engine.events import ConditionChanged, Event
from mavhums.results.assessment import Assessment
from mavhums.results.live import ActuatorStatus, AlertObject, LinkStatus, StaleObject, StatusObject
from mavhums.show.words import COLOURS, clock, friction, percent, printable

__all__ = ["View", "draw"]

_TOLD = 5


class View:
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
        self._told: deque[str] = deque(maxlen=_TOLD)
        self._live = Live(
            Text(f"{title}: waiting for a vehicle; Ctrl-C ends", style="dim"),
            console=console,
            auto_refresh=False,
            transient=True,
        )
        self._live.start()

    def consume(self, events: Sequence[Event], faults: dict[tuple[int, str], str]) -> None:
        """Remember the latest changes of condition."""
        for event in events:
            if isinstance(event, ConditionChanged):
                fault = faults.get((event.vehicle, event.actuator))
                why = f" ({fault})" if fault else ""
                self._told.append(
                    f"{clock(event.time_s)}  {event.actuator}: {event.before} → {event.after}{why}"
                )

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Draw the state."""
        self._live.update(draw(status, self._title, list(self._told)), refresh=True)

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Remember the alerts that were sent."""
        self._told.extend(f"said to the ground station: {alert.text}" for alert in alerts)

    def close(self, assessment: Assessment) -> None:
        """Remove the table; the verdicts are printed in its place."""
        self._live.stop()


def draw(status: StatusObject, title: str, told: Sequence[str] = ()) -> Group:
    """Return the display of the state."""
    head = Text(f"{title}   {clock(status.uptime_s)}", style="bold")
    parts: list[Text | Table] = [head, _table(status.actuators)]
    parts += [Text(printable(line)) for line in told]
    parts += [Text(line, style=style) for line, style in _link_lines(status.link)]
    if status.record:
        record = status.record
        if record.error:
            parts.append(
                Text(f"NOT RECORDED: {record.error}; {record.lost_frames:,} frames lost", style="bold red")
            )
        else:
            parts.append(Text(f"recording {record.path}, {record.bytes / 1e6:.1f} MB", style="dim"))
    parts += [
        Text(
            f"{output.name}: {output.dropped:,} dropped{f' ({output.error})' if output.error else ''}",
            "yellow",
        )
        for output in status.outputs
    ]
    parts.append(Text("Ctrl-C ends and prints the verdicts", style="dim"))
    return Group(*parts)


def _table(actuators: Sequence[ActuatorStatus]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for title in ("vehicle", "actuator", "condition", "friction, N·m", "network", "rate", "age", "late"):
        table.add_column(title, justify="left" if title in ("actuator", "condition") else "right")
    for status in actuators:
        table.add_row(
            "—" if status.vehicle is None else str(status.vehicle),
            printable(status.actuator),
            _condition(status),
            friction(status.friction_nm) if status.friction_nm else "—",
            percent(status.p_emergency) if status.p_emergency is not None else "—",
            f"{status.rate_hz:.0f} Hz",
            "—" if status.age_s is None else f"{status.age_s:.1f} s",
            f"{status.late:,}",
        )
    return table


def _condition(status: ActuatorStatus) -> Text:
    red, green, blue = COLOURS[status.condition]
    if status.stale:
        return Text(f"STALE, was {status.held}", style=f"bold reverse rgb({red},{green},{blue})")
    word = status.condition.upper() if status.condition in ("degraded", "emergency") else status.condition
    fault = f": {status.suspects[0].fault}" if status.suspects else ""
    return Text(f"{word}{fault}", style=f"bold rgb({red},{green},{blue})")


def _link_lines(link: LinkStatus) -> list[tuple[str, str]]:
    age = "nothing received yet" if link.age_s is None else f"last data {link.age_s:.1f} s ago"
    rates = f"{age}; {link.frames_per_s:,.0f} frames/s, {link.bytes_per_s / 1e3:,.1f} kB/s"
    counts = (
        (link.missing_frames, "missing by sequence number"),
        (link.reordered_frames, "overtaken"),
        (link.duplicated_frames, "twice"),
        (link.bad_crc_frames, "with a wrong checksum"),
        (link.bytes_skipped, "bytes of no frame"),
        (link.unknown_frames, "of an unknown kind"),
        (link.unsigned_frames, "unsigned"),
        (link.bad_signatures, "wrongly signed"),
        (link.replayed_frames, "replayed"),
        (link.dropped_datagrams, "datagrams not fetched in time"),
    )
    lost = ", ".join(f"{count:,} {what}" for count, what in counts if count)
    contested = [
        (f"vehicle {vehicle}: more than one sender speaks for it", "bold yellow")
        for vehicle in link.contested
    ]
    return [
        *contested,
        (f"{rates}; {link.frames:,} frames", "dim"),
        (f"lost or refused: {lost or 'nothing'}", "yellow" if lost else "dim"),
    ]
