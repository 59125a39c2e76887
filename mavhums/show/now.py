"""The blocks of a flight in progress: its state now, and what has changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from mavhums.core.conditions import Condition
from mavhums.results.live import ActuatorStatus, AlertObject, ConditionObject, LinkStatus, StatusObject
from mavhums.show.blocks import NOTHING, Block, Cell, Column, Headline, Mark, Note, TableBlock, table
from mavhums.show.verdict_words import class_words
from mavhums.show.words import clock, condition_word, counted, friction

_COLUMNS: Final = (
    Column("vehicle", "word"),
    Column("actuator"),
    Column("condition", "word"),
    Column("friction, N·m", "figure", 1),
    Column("network", "figure", 2),
    Column("rate", "figure", 3),
    Column("age", "figure", 2),
    Column("late", "figure", 4),
    Column("worst", "word", 5),
    Column("reason", "text", 6),
)


def status_blocks(status: StatusObject, title: str, latest: Sequence[str] = ()) -> list[Block]:
    """Return what is shown of a session's state.

    Parameters
    ----------
    status
        The state.
    title
        Of the session: its links, or its file.
    latest
        What has changed lately.
    """
    record = status.record
    notes: list[Note] = [Note(latest)] if latest else []
    if record and record.error:
        notes.append(Note([f"NOT RECORDED: {record.error}; {record.lost_frames:,} frames lost"]))
    elif record:
        notes.append(Note([f"recording {record.path}, {record.bytes / 1e6:.1f} MB"], quiet=True))
    slow = [
        f"{output.name}: {output.dropped:,} dropped{f' ({output.error})' if output.error else ''}"
        for output in status.outputs
    ]
    notes += [Note(slow)] if slow else []
    shown = _actuators(status.actuators)
    return [Headline(f"{title}   {clock(status.uptime_s)}"), shown, *_link(status.link), *notes]


def _actuators(actuators: Sequence[ActuatorStatus]) -> TableBlock:
    rows: list[list[Cell]] = [
        [
            NOTHING if one.vehicle is None else str(one.vehicle),
            one.actuator,
            [_now(one)],
            friction(one.friction_nm) if one.friction_nm else NOTHING,
            class_words(one.network, one.probability),
            f"{one.rate_hz:.0f} Hz",
            NOTHING if one.age_s is None else f"{one.age_s:.1f} s",
            f"{one.late:,}",
            [Mark(one.worst)],
            one.reason or NOTHING,
        ]
        for one in actuators
    ]
    return table("", _COLUMNS, rows)


def _now(one: ActuatorStatus) -> Mark:
    """Return the present condition with the suspected fault; of a silent actuator the last one known."""
    fault = f": {one.suspects[0].fault}" if one.suspects else ""
    return Mark(
        one.condition, f"STALE, was {one.held}" if one.stale else f"{condition_word(one.condition)}{fault}"
    )


def _link(link: LinkStatus) -> Iterator[Note]:
    age = "nothing received yet" if link.age_s is None else f"last data {link.age_s:.1f} s ago"
    rates = f"{age}; {link.frames_per_s:,.0f} frames/s, {link.bytes_per_s / 1e3:,.1f} kB/s"
    lost = ", ".join(counted(link))
    if link.contested:
        yield Note([f"vehicle {vehicle}: more than one sender transmits as it" for vehicle in link.contested])
    yield Note([f"{rates}; {link.frames:,} frames"], quiet=True)
    yield Note([f"lost or refused: {lost or 'nothing'}"], quiet=not lost)


def change_line(actuator: str, before: Condition, after: Condition, fault: str | None) -> str:
    """Return a change of condition in words.

    Examples
    --------
    >>> change_line("elevator", "normal", "emergency", "friction")
    'elevator: normal → emergency (friction)'
    """
    return f"{actuator}: {before} → {after}{f' ({fault})' if fault else ''}"


def latest_line(change: ConditionObject | AlertObject) -> str:
    """Return a change of a session's file, or an alert that it sent, in words."""
    if isinstance(change, AlertObject):
        return alert_line(change)
    return (
        f"{clock(change.time_s)}  {change_line(change.actuator, change.before, change.after, change.fault)}"
    )


def alert_line(alert: AlertObject) -> str:
    """Return an alert that was sent in words."""
    return f"sent to the ground station: {alert.text}"
