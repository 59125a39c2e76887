"""Tables: the verdicts, usage of outputs, indicators, where values came from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from math import floor, log10
from typing import Final

from mavhums.core.conditions import SEVERITY, URGENCY
from mavhums.core.output import printable
from mavhums.core.quantities import QUANTITIES
from mavhums.results.assessment import Assessment
from mavhums.results.sections import OutputUsage, VehicleUsage
from mavhums.results.verdict import ALL, MEASURED, Indicator, Interval, Verdict
from mavhums.show.blocks import NOTHING, Block, Cell, Column, Mark, Note, Part, TableBlock, table
from mavhums.show.verdict_words import control_left, course, excluded, judged, network_cell
from mavhums.show.words import clock, friction, merged, names, percent, place_of

_NUMBER: Final = re.compile(r"\d+")
ROWS: Final = 200
_BRIEF_ROWS: Final = 9
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
    Column("loss excluded", "text", 8),  # not in the short table
)


def verdict_table(assessment: Assessment, *, brief: bool) -> Iterator[Block]:
    """Yield the table of the verdicts; the short one has those that say something."""
    shown = [one for one in listed(assessment) if not (brief and one.gravest in _UNSAID)]
    groups = [*_alike(shown, assessment)]
    if not groups:
        return
    kinds = {alike[0].subject for alike in groups}
    columns = [Column(kinds.pop() if len(kinds) == 1 else "subject"), *_COLUMNS[: -1 if brief else None]]
    if columns[0].title == "motor":
        columns[2] = columns[2]._replace(title="thrust left")
    most, where = (_BRIEF_ROWS, "--verbose has them all") if brief else (ROWS, ALL_ROWS)
    rows = [_verdict_row(alike, assessment)[: len(columns)] for alike in groups[:most]]
    yield table("" if brief else "Verdicts", columns, rows)
    if len(groups) > most:
        yield Note([f"{len(groups) - most} more, less grave: {where}."])


def _verdict_row(alike: Sequence[Verdict], assessment: Assessment) -> list[Cell]:
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
        excluded(verdict),
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
        key = repr((verdict.subject, verdict.vehicle, _verdict_row([verdict], assessment)[1:]))
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


def _columns(*titles: str) -> list[Column]:
    return [*map(Column, titles)]


def usage(used: VehicleUsage, *, several: bool) -> TableBlock:
    """Return the use of a vehicle's servos: each surface, or where none is known each output that moved.

    Examples
    --------
    >>> flown = {"kind": "fixed wing", "firmware": "PX4", "armed_s": 90.0, "forward_s": 75.0}
    >>> usage(VehicleUsage(vehicle=1, outputs=(), **flown), several=False).title
    'Usage: fixed wing, PX4; armed 1m30s, forward flight 1m15s'
    """
    who = ", ".join(printable(words) for words in (used.kind, used.firmware) if words)
    armed = "armed time not recorded" if used.armed_s is None else f"armed {clock(used.armed_s)}"
    motion = "driven forward" if used.kind in ("ground rover", "surface boat") else "forward flight"
    times = [armed, *([f"{motion} {clock(used.forward_s)}"] if used.forward_s else [])]
    vehicle = f" of vehicle {used.vehicle}" if several else ""
    title = f"Usage{vehicle}: {'; '.join(filter(None, (who, ', '.join(times))))}"
    if motors := [output for output in used.outputs if output.bearing_deg is not None]:
        head = _columns("motor", "place", "mean output", "highest", "time at full output")
        return TableBlock(title, head, [_motor(output) for output in motors])
    named = [output for output in used.outputs if output.name]
    head = _columns("output", "span", "total travel", "reversals", "at its stops", "mean (trim)")
    rows = [_row(output) for output in named or used.outputs if output.commanded]
    for output in named:
        if not output.commanded:
            why = "no pulse in the log" if output.least_us is None else "never commanded"
            rows.append([_name(output), why, *[NOTHING] * (len(head) - 2)])
    return TableBlock(title, head, rows)


def _motor(output: OutputUsage) -> list[str]:
    """Return the use of a multirotor's motor, in shares of the range between idle and full output."""
    low, _, high = output.range_us or (0, 0, 0)
    known = output.commanded and high > low
    mean, highest = (
        percent(min(max((us - low) / (high - low), 0.0), 1.0)) if known and us is not None else NOTHING
        for us in (output.mean_us, output.greatest_us)
    )
    full = percent(output.at_high_s / output.held_s) if output.at_high_s and output.held_s else "0 %"
    return [_name(output), place_of(output.bearing_deg or 0.0), mean, highest, full]


def _name(output: OutputUsage) -> str:
    servo = f"servo {output.servo}" + (", inferred" if output.named_by == "inferred" else "")
    return f"{printable(output.name)} ({servo})" if output.name else servo


def _row(output: OutputUsage) -> list[str]:
    span = f"{(output.greatest_us or 0) - (output.least_us or 0)} µs"
    travelled = f"{output.travelled_us} µs"
    stops, mean = NOTHING, NOTHING
    if output.span is not None and output.travelled is not None:
        span, travelled = f"{percent(output.span)} of the range", f"{output.travelled:.1f} × the range"
    if output.at_low_s is not None and output.at_high_s is not None and output.held_s:
        stops = percent((output.at_low_s + output.at_high_s) / output.held_s)
    if output.mean_us is not None:
        mean = f"{output.mean_us:.0f} µs" + (f" (trim {output.range_us[1]} µs)" if output.range_us else "")
    return [_name(output), span, travelled, str(output.reversals), stops, mean]


def indicators(found: Sequence[Indicator]) -> TableBlock | None:
    """Return the estimates over the whole flight, with limits and baselines; None without one."""
    head = [*_columns("over the whole flight", "value (95 %)", "limit"), Column("own baseline", rank=1)]
    rows = [
        [
            item.quantity if item.unit == "1" else f"{item.quantity}, {item.unit}",
            f"{_figure(item.value.estimate, item.value)} ({_span(item.value)})",
            NOTHING if item.limit is None else f"{item.limit:.3g}",
            _span(item.baseline) if item.baseline else NOTHING,
        ]
        for item in found
    ]
    return table("", head, rows) if rows else None


def _span(interval: Interval) -> str:
    return f"{_figure(interval.low, interval)} to {_figure(interval.high, interval)}"


def _figure(value: float, interval: Interval) -> str:
    """Format a value with two significant digits of half the interval; zero has no sign."""
    half = (interval.high - interval.low) / 2
    digits = min(max(1 - floor(log10(half)), 0), 6) if half > 0 else 3
    return f"{value:z.{digits}f}"


def provenance(assessment: Assessment) -> TableBlock | None:
    """Return a row for each quantity, with the subjects of which it has a like source; None without one."""
    rows: dict[tuple[str, str], list[tuple[Verdict, str]]] = {}
    for verdict in assessment.ranked():
        tier = {"telemetry tier": verdict.tier} if verdict.tier else {}
        for key, source in (tier | verdict.provenance).items():
            alike = rows.setdefault((_quantity(verdict, key), _NUMBER.sub("#", source)), [])
            alike.append((verdict, source))
    cells: list[list[Cell]] = [
        [quantity, names([verdict for verdict, _ in alike], assessment), merged([text for _, text in alike])]
        for (quantity, _), alike in rows.items()
    ]
    return (
        TableBlock("Where the values came from", _columns("quantity", "of", "source"), cells)
        if cells
        else None
    )


def _quantity(verdict: Verdict, key: str) -> str:
    if verdict.subject != "actuator":
        return {"V1": "command", **MEASURED}.get(key, key)
    return next((f"{key} {one.name}, {one.unit}" for one in QUANTITIES if one.key == key), key)
