"""The assessment for the terminal: a table, worst first, and details below it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mavhums.actuator.tiers import TO_BE_JUDGED
from mavhums.core.conditions import Condition
from mavhums.report.assessment import Assessment, Verdict
from mavhums.show import _reserve, _usage
from mavhums.show._headline import headline
from mavhums.show._listing import heading, listed, without_wingless
from mavhums.show._network import beside, in_column
from mavhums.show._standing import control_left, course, judged, word
from mavhums.show._words import (
    COLOURS,
    advice,
    clock,
    explained,
    finding,
    friction,
    implausible,
    join,
    losses,
    name,
    percent,
    printable,
    undecided,
    unmonitored,
    whose,
)

__all__ = ["render", "render_findings"]

_SHOWN_EVIDENCE = 5


def render(assessment: Assessment, console: Console) -> None:
    """Print an assessment for a person.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    console
        Where to print; rich leaves the colours out where it is not a terminal.
    """
    console.print(Text(printable(headline(assessment)), style="bold"))
    rest, wingless = without_wingless(assessment)
    if any(
        verdict.gravest not in ("undecided", "unmonitored") or verdict.coverage.windows
        for verdict in rest.verdicts
    ):
        console.print(_table(rest, console.width))
    _print((*_findings(rest), *_remarks(rest)), console)
    for line in wingless if rest.verdicts else ():
        console.print(Text(printable(f"{line}.")))
    for line in _unmonitored(rest):
        console.print(Text(printable(line)))
    for said in whose(assessment.log):
        console.print(Text(printable(f"{said}.")))
    console.print(Text(printable(f"Log losses: {losses(assessment.log.losses)}."), style="dim"))
    console.print(Text(printable(f"{assessment.notice[:1].upper()}{assessment.notice[1:]}."), style="dim"))


def render_findings(assessment: Assessment, console: Console, title: str) -> None:
    """Print of an assessment what is not normal, under a title; nothing if there is no such thing."""
    rest, _ = without_wingless(assessment)
    found = list(_findings(rest))
    if found:
        console.print(Text(printable(title)), soft_wrap=True)
        _print(found, console)


def _print(paragraphs: Iterable[tuple[str, list[str]]], console: Console) -> None:
    for title, lines in paragraphs:
        console.print(Text(title, style="bold"))
        for line in lines:
            console.print(Padding(Text(printable(line)), (0, 0, 0, 2), expand=False))


_COLUMNS = ("subject", "condition", "control left", "friction, N·m", "network", "since", "moving", "judged")
_KEPT = (0, 1, 2, 3, 5, 7, 4, 6)  # the first two always, the others as far as the terminal is wide
_NOTHING = "—"
_GAP = 2


def _table(assessment: Assessment, width: int) -> Table:
    monitored = [verdict for verdict in listed(assessment) if verdict.gravest != "unmonitored"]
    subjects = {verdict.subject for verdict in monitored}
    titles = ("axis" if subjects == {"axis"} else "actuator", *_COLUMNS[1:])
    rows = [_row(verdict, assessment) for verdict in monitored]
    widths = [
        max(len(title), *(len(row[column]) for row in rows)) + _GAP for column, title in enumerate(titles)
    ]
    shown, taken = set(_KEPT[:2]), widths[0] + widths[1]
    for column in _KEPT[2:]:
        if all(row[column].plain == _NOTHING for row in rows):
            continue
        taken += widths[column]
        if taken <= width:
            shown.add(column)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for column in sorted(shown):
        least = min(widths[0] - _GAP, width * 2 // 3) if column == 0 else None
        table.add_column(
            titles[column],
            overflow="fold",
            justify="left" if column < 4 else "right",
            no_wrap=column in (1, 2, 3, 5, 7),
            min_width=least,
        )
    for row in rows:
        table.add_row(*(row[column] for column in sorted(shown)))
    return table


def _row(verdict: Verdict, assessment: Assessment) -> list[Text]:
    coverage = verdict.coverage
    return [
        Text(printable(name(verdict, assessment))),
        _condition(verdict),
        Text(control_left(verdict) or _NOTHING),
        Text(friction(verdict.friction_nm) if verdict.friction_nm else _NOTHING),
        Text(in_column(verdict)),
        Text(clock(verdict.since.flight_time_s) if verdict.since else _NOTHING),
        Text(percent(coverage.moving_fraction) if "V7" in verdict.provenance else _NOTHING),
        Text(judged(verdict) or _NOTHING),
    ]


def _condition(verdict: Verdict) -> Text:
    text, past = _word(verdict.condition), course(verdict)
    return text if past is None else Text.assemble(_word(past[0]), f" {past[1]}".rstrip(), ", then ", text)


def _word(condition: Condition) -> Text:
    red, green, blue = COLOURS[condition]
    return Text(word(condition), style=f"bold rgb({red},{green},{blue})")


def _findings(assessment: Assessment) -> Iterator[tuple[str, list[str]]]:
    """Yield a title and lines on what is not normal."""
    for verdict in assessment.ranked():
        if verdict.worst in ("degraded", "emergency"):
            shown = verdict.evidence[:_SHOWN_EVIDENCE]
            lines = [finding(item) for item in shown]
            if len(verdict.evidence) > len(shown):
                lines.append(f"and {len(verdict.evidence) - len(shown)} more findings (--json has them all)")
            yield (printable(name(verdict, assessment)), [*lines, f"what to do: {advice(verdict)}"])
    for (condition, reason, remedy), verdicts in explained(assessment).items():
        names = join(name(verdict, assessment) for verdict in verdicts)
        yield (printable(f"{names}: {condition}"), [f"why: {reason}", f"what to do: {remedy}"])
    for verdict in assessment.ranked():
        odd = implausible(verdict)
        if odd:
            yield (printable(f"{name(verdict, assessment)}: values in doubt"), [odd])
    for (reason, remedy), verdicts in undecided(assessment).items():
        names = join(name(verdict, assessment) for verdict in verdicts)
        yield (printable(f"{names}: undecided"), [f"why: {reason}", f"what to do: {remedy}"])


def _remarks(assessment: Assessment) -> Iterator[tuple[str, list[str]]]:
    """Yield a title and lines on what else the log tells."""
    said = beside(assessment)
    if said:
        yield ("Physics and network", said)
    left = list(_reserve.lines(assessment))
    if left:
        yield (_reserve.TITLE, left)
    for used in assessment.usage:
        yield (_usage.title(used, several=len(assessment.usage) > 1), list(_usage.lines(used)))


def _unmonitored(assessment: Assessment) -> Iterator[str]:
    """Yield a line for all servos that nothing monitors for the same reason."""
    for (reason, remedy), verdicts in unmonitored(assessment).items():
        more = "mavhums inspect LOG tells what to record" if remedy == TO_BE_JUDGED else remedy
        yield f"Unmonitored: {heading(verdicts, assessment)}: {reason} ({more})."
