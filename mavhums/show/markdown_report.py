"""The Markdown report inside a recording: the result first, then reasons and certainty."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from math import floor, log10
from typing import Final

from mavhums.core.about import NOTICE
from mavhums.core.output import printable
from mavhums.core.quantities import QUANTITIES
from mavhums.results.assessment import Assessment
from mavhums.results.standing import Interval
from mavhums.results.verdict import MEASURED, Indicator, Verdict
from mavhums.show.digest import Digest, Paragraph, Subject, advice, digest
from mavhums.show.verdict_words import certainty, explanation
from mavhums.show.words import (
    capital,
    clock,
    condition_word,
    finding,
    friction,
    join,
    name,
    percent,
)

_LIVE_COLUMNS: Final = ("actuator", "condition", "friction, N·m", "network", "since")
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
    said = digest(assessment)
    sections = [f"# {_literal(said.headline)}", f"*{assessment.notice}*"]
    sections += [f"{_literal(line)}." for line in said.without_wings]
    if said.subjects:
        sections.append(_table(said.subjects))
    sections += [_section(verdict, name(verdict, said.assessment)) for verdict in said.faulty]
    compared = [found for found in said.open if found.condition != "undecided"]
    undecided = [found for found in said.open if found.condition == "undecided"]
    sections += map(_paragraph, compared)
    sections += [
        f"## {_literal(of)}: values in doubt\n\n{_literal(capital(odd))}." for of, odd in said.doubtful
    ]
    sections += map(_paragraph, (*undecided, *said.unmonitored))
    for title, sentences in (("Over the flights", said.over_flights), ("Physics and network", said.network)):
        if sentences:
            sections.append(f"## {title}\n\n" + "\n".join(f"- {_literal(one)}." for one in sentences))
    for table in said.tables:
        rows = _rows((table.head, ("---",) * len(table.head), *(map(_literal, row) for row in table.rows)))
        sections.append(f"## {_literal(table.title)}" + (f"\n\n{rows}" if table.rows else ""))
    if said.events:
        sections.append(
            "## Events of the flight\n\n" + "\n".join(f"- {_literal(one)}." for one in said.events)
        )
    sections.append(_log(said, assessment))
    sections += _provenance(said.assessment)
    return "\n\n".join(sections) + "\n"


def _rows(rows: Iterable[Iterable[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _paragraph(found: Paragraph) -> str:
    why, todo = _literal(found.why), _literal(found.todo)
    return f"## {_literal(found.title)}: {found.condition}\n\n**Why:** {why}.\n\n**What to do:** {todo}."


def live_markdown(actuators: Iterable[tuple[str, str, Interval | None, str, float | None]]) -> str:
    """Return the report of a flight in progress.

    Parameters
    ----------
    actuators
        The worst first: name, condition, friction, what the network says, and since when it is so.
    """
    rows = [
        (
            _literal(title),
            condition if condition == "normal" else f"**{condition}**",
            friction(torque) if torque else "—",
            said,
            clock(since_s) if since_s is not None else "—",
        )
        for title, condition, torque, said, since_s in actuators
    ]
    table = _rows((_LIVE_COLUMNS, ("---",) * len(_LIVE_COLUMNS), *rows))
    end = "The report at the end of the flight gives reasons and advice."
    return f"# Now\n*{NOTICE}*\n\n{table}\n\n{end}\n"


def _table(subjects: Sequence[Subject]) -> str:
    """Return a row for each subject; what no row tells has no column."""
    kinds = {one.verdict.subject for one in subjects}
    rows = [_cells(one) for one in subjects]
    head: tuple[str, ...] = ("actuator" if kinds == {"actuator"} else "subject", *_COLUMNS)
    if kinds == {"motor"}:
        head = ("motor", _COLUMNS[0], "thrust left", *_COLUMNS[2:])
    shown = [k for k in range(len(head)) if k < 2 or any(row[k] != "—" for row in rows)]
    return _rows([line[k] for k in shown] for line in (head, ("---",) * len(head), *rows))


def _cells(one: Subject) -> tuple[str, ...]:
    present = one.verdict.condition if one.verdict.condition == "normal" else f"**{one.verdict.condition}**"
    past = f"{f'**{condition_word(one.past[0])}** {one.past[1]}'.rstrip()}, then " if one.past else ""
    cells = (one.control_left, one.friction, one.network, one.since)
    return (_literal(one.title), past + present, *(cell or "—" for cell in cells))


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
    if explained := explanation(verdict):
        lines.append(f"**Which surface:** {_literal(explained)}.")
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
    lines = [f"- {_literal(finding(item))}" for item in verdict.evidence]
    if len(lines) > _FIRST + _LAST + 1:
        left_out = len(lines) - _FIRST - _LAST
        lines[_FIRST:-_LAST] = [f"- … {left_out} more findings (`mavhums analyse --json` has them all)"]
    yield from lines


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
    return _rows(row[:width] for row in rows)


def _span(interval: Interval) -> str:
    return f"{_figure(interval.low, interval)} to {_figure(interval.high, interval)}"


def _figure(value: float, interval: Interval) -> str:
    """Format a value with two significant digits of half the interval; zero has no sign."""
    half = (interval.high - interval.low) / 2
    digits = min(max(1 - floor(log10(half)), 0), 6) if half > 0 else 3
    return f"{value:z.{digits}f}"


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
        table = [("quantity", "source"), ("---", "---")]
        quantities = {one.key: f"{one.key} {one.name}, {one.unit}" for one in QUANTITIES}
        if verdicts[0].subject == "axis":
            quantities = {"V1": "command", **MEASURED}
        if verdicts[0].subject == "motor":
            quantities = {"V1": "output"}
        for key, quantity in quantities.items():
            sources = [source for v in verdicts if (source := v.provenance.get(key))]
            source = _literal(_as_one(sources)) if sources else "not in the log"
            table.append((quantity, source))
        yield "\n\n".join([*lines, _rows(table)])


def _as_one(sources: Sequence[str]) -> str:
    """Write sources that differ in numbers alone as one.

    Examples
    --------
    >>> _as_one(["ESC_STATUS[0].rpm", "ESC_STATUS[1].rpm"])
    'ESC_STATUS[0/1].rpm'
    """
    parts = zip(*(_NUMBER.split(source) for source in sources), strict=True)
    return "".join(part[0] if len({*part}) == 1 else "/".join(part) for part in parts)


def _log(said: Digest, assessment: Assessment) -> str:
    log = assessment.log
    facts = [
        f"File: {_literal(log.path) if log.path else 'a live link'}",
        f"Start: {log.start_utc or 'not known'}; duration: {clock(log.duration_s)}",
        f"Losses: {said.losses}",
        f"Airframe: {_literal(assessment.airframe or 'none named')}; "
        f"network: {_literal(assessment.model.name) if assessment.model else 'none'}",
        *map(_literal, said.flight_notes),
    ]
    return "## The log\n\n" + "\n".join(f"- {fact}" for fact in facts)


def _literal(text: str) -> str:
    """Return an external text on one line, with Markdown characters escaped."""
    return _ACTIVE.sub(r"\\\1", printable(text))
