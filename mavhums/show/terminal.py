"""The assessment for the terminal: a table, worst first, and below it why, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mavhums.actuator.telemetry import TO_BE_JUDGED
from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.errors import GRAVEST_FIRST, ExitCode, MavhumsError
from mavhums.core.output import printable
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.digest import Digest, Paragraph, Subject, advice, digest
from mavhums.show.verdict_words import explanation
from mavhums.show.words import COLOURS, capital, condition_word, finding, join, name

_FINDINGS = 3  # with headline and table they fit a screen of 24 lines


def render(assessment: Assessment, console: Console, *, verbose: bool = False) -> None:
    """Print an assessment for a person: what is wrong, or that nothing is, and what to do.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    console
        Where to print; rich leaves the colours out where it is not a terminal.
    verbose
        Print every reason and finding, servo usage, and unmonitored servos, too.
    """
    said = digest(assessment, brief=not verbose)
    console.print(Text(printable(said.headline), style="bold"))
    first = [note for note in said.flight_notes if note.startswith(capital(NOT_COMPARED))]
    for note in first:
        console.print(Text(printable(f"{note}.")))
    monitored = [one for one in said.subjects if one.verdict.gravest != "unmonitored"]
    if any(one.verdict.gravest != "undecided" or one.verdict.coverage.windows for one in monitored):
        console.print(_table(monitored, console.width))
    _print_found(said, _findings(said, verbose=verbose), console)
    if said.network:
        _print("Physics and network", said.network, console)
    for table in said.tables if verbose else ():
        _print(table.title, table.lines, console)
    plain = [*said.without_wings, *said.foremost, *(one for one in said.flight_notes if one not in first)]
    if verbose:
        plain += [_unmonitored(found) for found in said.unmonitored]
    for line in plain:
        console.print(Text(printable(f"{line}.")))
    hidden = [] if verbose else [*_hidden(said)]
    end = f"Log losses: {said.losses}. {capital(assessment.notice)}."
    end += f" --verbose adds {join(hidden)}." if hidden else ""
    console.print(Text(printable(end), style="dim"))


def render_findings(assessment: Assessment, console: Console, title: str) -> None:
    """Print of an assessment what is not normal, under a title; nothing if there is no such thing."""
    said = digest(assessment, brief=True)
    findings = list(_findings(said, verbose=False))
    if findings or said.open or said.over_flights:
        console.print(Text(printable(title)), soft_wrap=True)
    _print_found(said, findings, console)


def _print_found(said: Digest, findings: Iterable[tuple[str, list[str]]], console: Console) -> None:
    """Print findings, what is open and why, and what is so over the flights."""
    for title, lines in findings:
        _print(title, lines, console)
    for found, following in zip_longest(said.open, said.open[1:]):
        # An ordinary flight has a few, and one screen: they stand behind their names.
        more = f" (and {found.left_out} more: --verbose)" if found.left_out else ""
        head = (printable(f"{found.title}: {found.condition}"), "bold")
        console.print(Text.assemble(head, printable(f": {found.why}{more}")))
        if following is None or following.todo != found.todo:
            console.print(indented(f"what to do: {found.todo}"))
    if said.over_flights:
        _print("Over the flights", said.over_flights, console)


def condition_text(condition: Condition) -> Text:
    """Return a condition as a table shows it, in its colour."""
    red, green, blue = COLOURS[condition]
    return Text(condition_word(condition), style=f"bold rgb({red},{green},{blue})")


def indented(line: str, left: int = 2) -> Padding:
    """Return a line that is indented wherever it wraps."""
    return Padding(Text(printable(line)), (0, 0, 0, left), expand=False)


def _print(title: str, lines: Sequence[str], console: Console) -> None:
    console.print(Text(printable(title), style="bold"))
    for line in lines:
        console.print(indented(line))


_COLUMNS = ("subject", "condition", "control left", "friction, N·m", "network", "since", "moving", "judged")
_KEPT = (0, 1, 2, 3, 5, 7, 4, 6)  # the first two always, the others as far as the terminal is wide
_NOTHING = "—"
_GAP = 2


def _table(subjects: Sequence[Subject], width: int) -> Table:
    kinds = {one.verdict.subject for one in subjects}
    first = kinds.pop() if len(kinds) == 1 else "actuator"
    left = "thrust left" if first == "motor" else _COLUMNS[2]
    titles = (first, _COLUMNS[1], left, *_COLUMNS[3:])
    rows = [_row(one) for one in subjects]
    widths = [
        max(len(title), *(len(row[column]) for row in rows)) + _GAP for column, title in enumerate(titles)
    ]
    shown, used = set(_KEPT[:2]), widths[0] + widths[1]
    for column in _KEPT[2:]:
        if all(row[column].plain == _NOTHING for row in rows):
            continue
        used += widths[column]
        if used <= width:
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


def _row(one: Subject) -> list[Text]:
    condition = condition_text(one.verdict.condition)
    if one.past:
        before = Text.assemble(condition_text(one.past[0]), f" {one.past[1]}".rstrip())
        condition = Text.assemble(before, ", then ", condition)
    cells = (one.control_left, one.friction, one.network, one.since, one.moving, one.judged)
    return [Text(printable(one.title)), condition, *(Text(cell or _NOTHING) for cell in cells)]


def _findings(said: Digest, *, verbose: bool) -> Iterator[tuple[str, list[str]]]:
    """Yield a title and lines on what is not normal."""
    for verdict in said.faulty:
        # The latest findings say what is so now, and why.
        shown = verdict.evidence if verbose else verdict.evidence[-_FINDINGS:]
        lines = [finding(item) for item in shown]
        if len(verdict.evidence) > len(shown):
            lines.insert(0, f"{len(verdict.evidence) - len(shown)} earlier findings (--verbose has them)")
        if explained := explanation(verdict):
            lines.append(explained)
        yield name(verdict, said.assessment), [*lines, f"what to do: {advice(verdict)}"]
    for subject, odd in said.doubtful:
        yield f"{subject}: values in doubt", [odd]


def _unmonitored(found: Paragraph) -> str:
    more = "mavhums inspect LOG tells what to record" if found.todo == TO_BE_JUDGED else found.todo
    return f"Unmonitored: {found.title}: {found.why} ({more})"


def _hidden(said: Digest) -> Iterator[str]:
    """Yield what a short answer leaves out."""
    if any(found.left_out for found in said.open):
        yield "the other reasons"
    if any(len(verdict.evidence) > _FINDINGS for verdict in said.faulty):
        yield "all findings"
    if said.tables:
        yield "servo usage"
    if said.unmonitored:
        yield "unmonitored servos"


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
    """Return what was found in a few words, for reasons and remedies stand elsewhere.

    Examples
    --------
    >>> axis = Verdict(subject="axis", vehicle=1, actuator="roll", condition="normal", worst="normal")
    >>> _names_in([axis, axis.model_copy(update={"actuator": "pitch"})], "normal")
    'roll and pitch normal'
    """
    said = digest(assessment)
    ranked = said.assessment.ranked()
    if not ranked:
        return "; ".join(line.partition(" (")[0] for line in said.headline.split("; "))
    if SEVERITY[ranked[0].gravest] > SEVERITY["normal"]:
        return said.headline
    parts = [_names_in(ranked, condition) for condition in ("normal", "unchanged", "learning", "undecided")]
    return "; ".join(filter(None, parts)) or "servos unmonitored"


def _names_in(verdicts: Sequence[Verdict], condition: Condition) -> str:
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
    for line in sorted(
        lines, key=lambda line: (GRAVEST_FIRST.index(line.code), -URGENCY[line.worst or "undecided"])
    ):
        shown = line.log.name if names.count(line.log.name) == 1 else str(line.log)
        condition = Text("unreadable", style="bold") if line.worst is None else condition_text(line.worst)
        table.add_row(Text(printable(shown)), condition, Text(printable(line.what)), str(int(line.code)))
    console.print(table)
