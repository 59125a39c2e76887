"""Many logs in one table for the terminal, worst first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.errors import GRAVEST_FIRST, ExitCode, MavhumsError
from mavhums.core.text import printable
from mavhums.report.assessment import ALL, Assessment, Verdict
from mavhums.show.digest import digest
from mavhums.show.terminal import condition_text
from mavhums.show.words import join

__all__ = ["Line", "line_of", "render_many"]


class Line(NamedTuple):
    """One log: its worst condition (None if it cannot be read), what was found, and its exit code."""

    log: Path
    worst: Condition | None
    what: str
    code: ExitCode


def line_of(log: Path, judged: Assessment | MavhumsError) -> Line:
    """Return the line on a log that was judged, or on one that could not be read."""
    if isinstance(judged, MavhumsError):
        return Line(log, None, judged.problem.removeprefix(f"{log}: "), ExitCode.ERROR)
    ranked = judged.ranked()
    worst: Condition = ranked[0].gravest if ranked else "undecided"
    return Line(log, worst, _what(judged), judged.exit_code)


def _what(assessment: Assessment) -> str:
    """Return what was found in a few words, for reasons and remedies are told elsewhere.

    Examples
    --------
    >>> axis = Verdict(subject="axis", vehicle=1, actuator="roll", condition="normal", worst="normal")
    >>> _told([axis, axis.model_copy(update={"actuator": "pitch"})], "normal")
    'roll and pitch normal'
    """
    said = digest(assessment)
    ranked = said.assessment.ranked()
    if not ranked:
        return "; ".join(line.partition(" (")[0] for line in said.headline.split("; "))
    if SEVERITY[ranked[0].gravest] > SEVERITY["normal"]:
        return said.headline
    parts = [_told(ranked, condition) for condition in ("normal", "unchanged", "learning", "undecided")]
    return "; ".join(filter(None, parts)) or "servos unmonitored"


def _told(verdicts: Sequence[Verdict], condition: Condition) -> str:
    """Return which verdicts have a condition; empty if none has."""
    names = ["actuators" if v.actuator == ALL else v.actuator for v in verdicts if v.gravest == condition]
    return f"{join(names)} {'not judged' if condition == 'undecided' else condition}" if names else ""


def render_many(lines: Sequence[Line], console: Console) -> None:
    """Print a table of many logs, worst first, in which logs of like gravity keep their order."""
    names = [line.log.name for line in lines]
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("log", overflow="fold", max_width=max(console.width * 2 // 5, 12))
    table.add_column("worst", no_wrap=True)
    table.add_column("what", overflow="fold")
    table.add_column("exit", justify="right", no_wrap=True)
    for line in sorted(lines, key=_gravity):
        shown = line.log.name if names.count(line.log.name) == 1 else str(line.log)
        condition = Text("unreadable", style="bold") if line.worst is None else condition_text(line.worst)
        table.add_row(Text(printable(shown)), condition, Text(printable(line.what)), str(int(line.code)))
    console.print(table)


def _gravity(line: Line) -> tuple[int, int]:
    return GRAVEST_FIRST.index(line.code), -URGENCY[line.worst or "undecided"]
