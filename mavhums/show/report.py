"""The Markdown report inside a recording: the result first, then reasons and certainty."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from math import floor, log10
from typing import Final

from mavhums.core.quantities import QUANTITIES
from mavhums.report.assessment import NOTICE, Assessment, Indicator, Interval, Verdict
from mavhums.show import _usage
from mavhums.show._certainty import certainty
from mavhums.show._headline import headline
from mavhums.show._listing import heading, listed, together, without_wingless
from mavhums.show._network import beside, in_column
from mavhums.show._standing import control_left, course, word
from mavhums.show._words import (
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

__all__ = ["markdown", "so_far"]

_HEAD: Final = ("| actuator | condition | friction, N·m | network | since |", "|---|---|---|---|---|")
_COLUMNS: Final = ("condition", "control left", "friction, N·m", "network", "since")
_FIRST, _LAST = 4, 6
_NUMBER = re.compile(r"(\d+)")
_ACTIVE = re.compile(r"([\\`*\[\]<|])")


def markdown(assessment: Assessment) -> str:
    """Return the assessment as a report in Markdown.

    Parameters
    ----------
    assessment
        The verdicts of one log.

    Returns
    -------
    str
        The result in the first line; then the actuators, worst first, with advice, reasons and
        certainty; then the log's losses and the provenance of each value.
    """
    sections = [f"# {_literal(headline(assessment))}", f"*{assessment.notice}*"]
    assessment, wingless = without_wingless(assessment)
    sections += [f"{_literal(line)}." for line in wingless if assessment.verdicts]
    if assessment.verdicts:
        sections.append(_table(assessment))
    ranked = assessment.ranked()
    told = [verdict for verdict in ranked if verdict.worst in ("degraded", "emergency")]
    sections += [_section(verdict, name(verdict, assessment)) for verdict in told]
    sections += _explained(assessment)
    sections += _doubtful(assessment)
    sections += _undecided(assessment)
    sections += _beside(assessment)
    sections += _used(assessment)
    sections.append(_log(assessment))
    sections += _provenance(assessment)
    return "\n\n".join(sections) + "\n"


def so_far(actuators: Iterable[tuple[str, str, Interval | None, float | None, float | None]]) -> str:
    """Return the report of a flight in progress.

    Parameters
    ----------
    actuators
        The worst first: name, condition, friction, the network's vote, and since when it is so.
    """
    lines = ["# Now", f"*{NOTICE}*\n", *_HEAD]
    for title, condition, torque, vote, since_s in actuators:
        word = condition if condition == "normal" else f"**{condition}**"
        lines.append(_row(title, word, torque, vote, since_s))
    lines.append("\nThe report at the end of the flight gives reasons and advice.")
    return "\n".join(lines) + "\n"


def _row(
    title: str, condition: str, torque: Interval | None, vote: float | None, since_s: float | None
) -> str:
    cells = (
        _literal(title),
        condition,
        friction(torque) if torque else "—",
        percent(vote) if vote is not None else "—",
        clock(since_s) if since_s is not None else "—",
    )
    return f"| {' | '.join(cells)} |"


def _table(assessment: Assessment) -> str:
    """Return a row for each subject; what no row tells has no column."""
    rows = [_cells(alike[0], heading(alike, assessment)) for alike in together(listed(assessment))]
    subjects = {verdict.subject for verdict in assessment.verdicts}
    head = ("actuator" if subjects == {"actuator"} else "subject", *_COLUMNS)
    told = [k for k in range(len(head)) if k < 2 or any(row[k] != "—" for row in rows)]
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line[k] for k in told)} |" for line in lines)


def _cells(verdict: Verdict, title: str) -> tuple[str, ...]:
    return (
        _literal(title),
        _condition(verdict),
        control_left(verdict) or "—",
        friction(verdict.friction_nm) if verdict.friction_nm else "—",
        in_column(verdict),
        clock(verdict.since.flight_time_s) if verdict.since else "—",
    )


def _condition(verdict: Verdict) -> str:
    present = f"**{verdict.condition}**" if verdict.condition != "normal" else verdict.condition
    past = course(verdict)
    return present if past is None else f"{f'**{word(past[0])}** {past[1]}'.rstrip()}, then {present}"


def _section(verdict: Verdict, title: str) -> str:
    lines = [f"## {_literal(title)}: {verdict.worst}", f"**What to do:** {advice(verdict)}."]
    since = (
        f"{clock(verdict.since.flight_time_s)} into the log ({verdict.since.utc})" if verdict.since else ""
    )
    if verdict.condition != verdict.worst:
        again = f"since {since}" if since else "at the end"
        lines.append(f"It is {verdict.condition} {again}; the earlier finding stands.")
    elif since:
        lines.append(f"**Since:** {since}.")
    if verdict.evidence:
        lines.append("\n".join(["**Why:**", *_findings(verdict)]))
    if verdict.suspects:
        suspects = (f"{_literal(item.fault)} ({percent(item.confidence)})" for item in verdict.suspects)
        lines.append(f"**Suspected:** {join(suspects)}.")
    if verdict.indicators:
        lines.append(_indicators(verdict.indicators))
    if verdict.surfaces:
        lines.append(f"**Surfaces:** {_literal(join(verdict.surfaces))}.")
    lines.append(f"**How sure:** {certainty(verdict)}.")
    return "\n\n".join(lines)


def _findings(verdict: Verdict) -> Iterator[str]:
    """Yield the findings; if there are many, only the first and the last ones."""
    told = [f"- {_literal(finding(item))}" for item in verdict.evidence]
    if len(told) > _FIRST + _LAST + 1:
        left_out = len(told) - _FIRST - _LAST
        told[_FIRST:-_LAST] = [f"- … {left_out} more findings (`mavhums analyse --json` has them all)"]
    yield from told


def _indicators(found: Sequence[Indicator]) -> str:
    """Return a table of the estimates over the whole flight, with limits and baselines."""
    head = ["over the whole flight", "value (95 %)", "limit", "own baseline"]
    rows = [head, ["---"] * len(head)]
    for item in found:
        unit = "" if item.unit == "1" else f", {item.unit}"
        limit = "—" if item.limit is None else f"{item.limit:.3g}"
        own = _span(item.baseline) if item.baseline else "—"
        value = f"{_figure(item.value.estimate, item.value)} ({_span(item.value)})"
        rows.append([_literal(cell) for cell in (f"{item.quantity}{unit}", value, limit, own)])
    width = len(head) if any(item.baseline for item in found) else len(head) - 1
    return "\n".join(f"| {' | '.join(row[:width])} |" for row in rows)


def _span(interval: Interval) -> str:
    return f"{_figure(interval.low, interval)} to {_figure(interval.high, interval)}"


def _figure(value: float, interval: Interval) -> str:
    """Format a value with two significant digits of half the interval; zero has no sign."""
    half = (interval.high - interval.low) / 2
    digits = min(max(1 - floor(log10(half)), 0), 6) if half > 0 else 3
    return f"{value:z.{digits}f}"


def _explained(assessment: Assessment) -> Iterator[str]:
    for (condition, reason, remedy), verdicts in explained(assessment).items():
        names = _literal(join(name(verdict, assessment) for verdict in verdicts))
        why, what = _literal(reason), _literal(remedy)
        yield f"## {names}: {condition}\n\n**Why:** {why}.\n\n**What to do:** {what}."


def _doubtful(assessment: Assessment) -> Iterator[str]:
    for verdict in assessment.ranked():
        odd = implausible(verdict)
        if odd:
            title = _literal(name(verdict, assessment))
            yield f"## {title}: values in doubt\n\n{_literal(odd[:1].upper() + odd[1:])}."


def _undecided(assessment: Assessment) -> Iterator[str]:
    for (reason, remedy), verdicts in undecided(assessment).items():
        names = _literal(join(name(verdict, assessment) for verdict in verdicts))
        yield f"## {names}: undecided\n\n**Why:** {_literal(reason)}.\n\n**What to do:** {_literal(remedy)}."
    for (reason, remedy), verdicts in unmonitored(assessment).items():
        names = _literal(join(name(verdict, assessment) for verdict in verdicts))
        why, todo = _literal(reason), _literal(remedy)
        yield f"## {names}: unmonitored\n\n**Why:** {why}.\n\n**What to do:** {todo}."


def _beside(assessment: Assessment) -> Iterator[str]:
    said = beside(assessment)
    if said:
        lines = "\n".join(f"- {_literal(sentence)}." for sentence in said)
        yield f"## Physics and network\n\n{lines}"


def _used(assessment: Assessment) -> Iterator[str]:
    """Yield a table of what was used of each vehicle's servos."""
    for usage in assessment.usage:
        rows = [tuple(map(_literal, row)) for row in _usage.rows(usage)]
        table = "\n".join(
            f"| {' | '.join(row)} |" for row in (_usage.HEAD, ("---",) * len(_usage.HEAD), *rows)
        )
        title = _literal(_usage.title(usage, several=len(assessment.usage) > 1))
        yield f"## {title}" + (f"\n\n{table}" if rows else "")


def _provenance(assessment: Assessment) -> Iterator[str]:
    """Yield a table of sources for each group of actuators whose sources differ only in numbers."""
    groups: dict[object, list[Verdict]] = {}
    for verdict in assessment.ranked():
        if verdict.provenance:
            alike = {key: _NUMBER.sub("#", source) for key, source in verdict.provenance.items()}
            groups.setdefault((verdict.tier, *sorted(alike.items())), []).append(verdict)
    for verdicts in groups.values():
        names, tier = (name(verdict, assessment) for verdict in verdicts), verdicts[0].tier
        lines = [f"## Where the values of {_literal(join(names))} came from"]
        lines += [f"Telemetry tier: {_literal(tier)}."] if tier else []
        table = ["| quantity | source |", "|---|---|"]
        for quantity in QUANTITIES:
            sources = [source for v in verdicts if (source := v.provenance.get(quantity.key))]
            source = _literal(_as_one(sources)) if sources else "not in the log"
            table.append(f"| {quantity.key} {quantity.name}, {quantity.unit} | {source} |")
        yield "\n\n".join([*lines, "\n".join(table)])


def _as_one(sources: Sequence[str]) -> str:
    """Write sources that differ in numbers alone as one.

    Examples
    --------
    >>> _as_one(["ESC_STATUS[0].rpm", "ESC_STATUS[1].rpm"])
    'ESC_STATUS[0/1].rpm'
    """
    parts = zip(*(_NUMBER.split(source) for source in sources), strict=True)
    return "".join(part[0] if len({*part}) == 1 else "/".join(part) for part in parts)


def _log(assessment: Assessment) -> str:
    log = assessment.log
    facts = [
        f"File: {_literal(log.path) if log.path else 'a live link'}",
        f"Start: {log.start_utc or 'not known'}; duration: {clock(log.duration_s)}",
        f"Losses: {losses(log.losses)}",
        f"Airframe: {_literal(assessment.airframe or 'none named')}; "
        f"network: {_literal(assessment.model.name) if assessment.model else 'none'}",
    ]
    facts += map(_literal, whose(log))
    return "## The log\n\n" + "\n".join(f"- {fact}" for fact in facts)


def _literal(text: str) -> str:
    """Return an external text on one line, with Markdown characters escaped."""
    return _ACTIVE.sub(r"\\\1", printable(text))
