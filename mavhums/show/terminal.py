"""The assessment on a terminal: a table, the worst first, and below it what the table cannot say."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mavhums.core.conditions import Condition
from mavhums.report.assessment import Assessment, Verdict
from mavhums.show._words import (
    COLOURS,
    advice,
    clock,
    effectiveness,
    explained,
    finding,
    friction,
    headline,
    join,
    losses,
    name,
    percent,
    printable,
    undecided,
    unmonitored,
)

__all__ = ["render"]

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
    if any(verdict.gravest != "unmonitored" for verdict in assessment.verdicts):
        console.print(_table(assessment))
    for title, lines in _paragraphs(assessment):
        console.print(Text(title, style="bold"))
        for line in lines:
            console.print(Padding(Text(printable(line)), (0, 0, 0, 2), expand=False))
    console.print(Text(printable(f"Lost of the log: {losses(assessment.log.losses)}."), style="dim"))
    console.print(Text(printable(f"{assessment.notice[:1].upper()}{assessment.notice[1:]}."), style="dim"))


def _table(assessment: Assessment) -> Table:
    shown = [verdict for verdict in assessment.ranked() if verdict.gravest != "unmonitored"]
    axes = any(verdict.subject == "axis" for verdict in shown)
    actuators = any(verdict.subject == "actuator" for verdict in shown)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("actuator" if actuators else "axis", overflow="fold")
    table.add_column("condition")
    if axes:
        table.add_column("control left", no_wrap=True)
    if actuators:
        table.add_column("friction, N·m", no_wrap=True)
        table.add_column("network", justify="right")
    table.add_column("since", justify="right", no_wrap=True)
    if actuators:
        table.add_column("moving", justify="right")
    table.add_column("judged", justify="right", no_wrap=True)
    for verdict in shown:
        table.add_row(*_row(verdict, assessment, axes=axes, actuators=actuators))
    return table


def _row(verdict: Verdict, assessment: Assessment, *, axes: bool, actuators: bool) -> list[Text | str]:
    coverage = verdict.coverage
    cells: list[Text | str] = [Text(printable(name(verdict, assessment))), _condition(verdict)]
    if axes:
        cells.append(effectiveness(verdict.effectiveness) if verdict.effectiveness else "—")
    if actuators:
        cells.append(friction(verdict.friction_nm) if verdict.friction_nm else "—")
        cells.append(percent(verdict.p_emergency) if verdict.p_emergency is not None else "—")
    cells.append(clock(verdict.since.flight_time_s) if verdict.since else "—")
    if actuators:
        cells.append(percent(coverage.moving_fraction))
    cells.append(f"{coverage.decidable}/{coverage.windows}")
    return cells


def _condition(verdict: Verdict) -> Text:
    text = _word(verdict.condition)
    return text if verdict.worst == verdict.condition else Text.assemble(text, " was ", _word(verdict.worst))


def _word(condition: Condition) -> Text:
    red, green, blue = COLOURS[condition]
    word = condition.upper() if condition in ("changed", "degraded", "emergency") else condition
    return Text(word, style=f"bold rgb({red},{green},{blue})")


def _paragraphs(assessment: Assessment) -> Iterator[tuple[str, list[str]]]:
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
    for (reason, remedy), verdicts in undecided(assessment).items():
        names = join(name(verdict, assessment) for verdict in verdicts)
        yield (printable(f"{names}: undecided"), [f"why: {reason}", f"what to do: {remedy}"])
    for (reason, remedy), verdicts in unmonitored(assessment).items():
        names = join(name(verdict, assessment) for verdict in verdicts)
        yield (printable(f"{names}: unmonitored"), [f"why: {reason}", f"what to do: {remedy}"])
