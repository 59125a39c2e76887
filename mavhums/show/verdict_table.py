"""The table of the verdicts, like ones in one row."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from mavhums.core.conditions import SEVERITY, URGENCY
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.blocks import NOTHING, Block, Cell, Column, Mark, Note, Part, table
from mavhums.show.verdict_words import control_left, course, judged, network_cell
from mavhums.show.words import clock, friction, names, percent

ROWS: Final = 200
ALL_ROWS: Final = "mavhums analyse --json has them all"
"""What is said of what comes after :data:`ROWS`."""

_UNSAID: Final = ("unmonitored", "undecided", "learning")  # a row has nothing to say of these
_COLUMNS: Final = (
    Column("condition", "word"),
    Column("control left", "word", 1),
    Column("friction, N·m", "word", 2),
    Column("network", "figure", 5),
    Column("since", "figure", 3),
    Column("moving", "figure", 6),
    Column("judged", "figure", 4),
    Column("moved by", "text", 7),
)


def verdict_table(assessment: Assessment, *, brief: bool) -> Iterator[Block]:
    """Yield the table of the verdicts; the short one has those that say something."""
    shown = [one for one in listed(assessment) if not (brief and one.gravest in _UNSAID)]
    groups = [*_alike(shown, assessment)]
    if not groups:
        return
    kinds = {alike[0].subject for alike in groups}
    columns = [Column(kinds.pop() if len(kinds) == 1 else "subject"), *_COLUMNS]
    if columns[0].title == "motor":
        columns[2] = columns[2]._replace(title="thrust left")
    yield table("" if brief else "Verdicts", columns, [_row(alike, assessment) for alike in groups[:ROWS]])
    if len(groups) > ROWS:
        yield Note([f"{len(groups) - ROWS} more, less grave: {ALL_ROWS}."])


def _row(alike: Sequence[Verdict], assessment: Assessment) -> list[Cell]:
    verdict, past = alike[0], course(alike[0])
    moving = verdict.coverage.moving_fraction if "V7" in verdict.provenance else None
    before: list[Part] = [Mark(past[0]), f" {past[1]}".rstrip(), ", then "] if past else []
    cells = (
        control_left(verdict),
        friction(verdict.friction_nm) if verdict.friction_nm else None,
        network_cell(verdict),
        clock(verdict.since.flight_time_s) if verdict.since else None,
        None if moving is None else percent(moving),
        judged(verdict),
        ", ".join(verdict.surfaces),
    )
    return [
        _title(alike, assessment),
        [*before, Mark(verdict.condition)],
        *(cell or NOTHING for cell in cells),
    ]


def _alike(verdicts: Iterable[Verdict], assessment: Assessment) -> Iterator[list[Verdict]]:
    """Yield the verdicts, as one those on like subjects whose rows differ in nothing but the name."""
    rows: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        key = repr((verdict.subject, verdict.vehicle, _row([verdict], assessment)[1:]))
        rows.setdefault(key, []).append(verdict)
    yield from rows.values()


def listed(assessment: Assessment) -> list[Verdict]:
    """Return the verdicts worst first, axes before servos; where nothing is wrong, what is well comes first.

    A verdict that something is wrong must not be overlooked; among others, what could not be judged would
    hide that all that could be judged is well.
    """
    ranked = sorted(assessment.ranked(), key=lambda verdict: verdict.subject != "axis")
    wrong = any(SEVERITY[verdict.gravest] > SEVERITY["normal"] for verdict in ranked)
    order = URGENCY if wrong else SEVERITY
    return sorted(ranked, key=lambda verdict: -order[verdict.gravest])


def _title(alike: Sequence[Verdict], assessment: Assessment) -> str:
    """Return the subject of verdicts in one row: of a servo without telemetry it is the wear alone."""
    unseen = alike[0].gravest == "unmonitored" and alike[0].actuator != ALL
    return f"wear of {names(alike, assessment)}" if unseen else names(alike, assessment)
