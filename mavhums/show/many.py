"""The table of many logs: a line on each, the worst first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import GRAVEST_FIRST, ExitCode, MavhumsError
from mavhums.results.assessment import Assessment
from mavhums.show.answer import headline_block
from mavhums.show.blocks import Cell, Column, Mark, Table


class Line(NamedTuple):
    """One log: its mark (None if it cannot be read), what was found, and its exit code."""

    log: Path
    worst: Mark | None
    what: str
    code: ExitCode


def line_of(log: Path, outcome: Assessment | MavhumsError) -> Line:
    """Return the line on a log that was judged, or on one that could not be read."""
    if isinstance(outcome, MavhumsError):
        return Line(log, None, outcome.problem.removeprefix(f"{log}: "), ExitCode.ERROR)
    brief = headline_block(outcome)
    return Line(log, brief.mark, brief.text, outcome.exit_code)


def many(lines: Sequence[Line]) -> Table:
    """Return a table of many logs, worst first, in which logs of like gravity keep their order."""
    names = [line.log.name for line in lines]
    rows: list[list[Cell]] = [
        [
            line.log.name if names.count(line.log.name) == 1 else str(line.log),
            "unreadable" if line.worst is None else [line.worst],
            line.what,
            str(int(line.code)),
        ]
        for line in sorted(lines, key=_place)
    ]
    columns = (Column("log"), Column("worst", "word"), Column("what"), Column("exit", "figure"))
    return Table("", columns, rows)


def _place(line: Line) -> tuple[int, int]:
    return GRAVEST_FIRST.index(line.code), -URGENCY[line.worst.condition if line.worst else "undecided"]
