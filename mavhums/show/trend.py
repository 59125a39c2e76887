"""Reports over flights: an actuator's state, its trend with curves, what changed in a fleet."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.health.decision.baseline import LOSSES
from mavhums.results.assessment import Assessment
from mavhums.results.standing import (
    ActuatorTrend,
    RepairDate,
    Standing,
    TrendReport,
)
from mavhums.results.verdict import Interval
from mavhums.show.answer import blocks
from mavhums.show.blocks import Block, Cell, Column, Headline, Mark, Note, TableBlock
from mavhums.show.curves import Curve
from mavhums.show.evidence import Limit
from mavhums.show.html_plot import Chart, chart
from mavhums.show.standing import growth_words, sentences, since_words, soonest_words, step_words
from mavhums.show.words import capital, group_name, join, levels, subject_of

_BARS = "▁▂▃▄▅▆▇█"
_CELLS = 8


def short_blocks(result: Assessment | TrendReport) -> list[Block]:
    """Return what is shown of a result where there is little room."""
    return blocks(result, brief=True) if isinstance(result, Assessment) else trend_blocks(result)


def trend_blocks(report: TrendReport) -> list[Block]:
    """Return what is shown of a report; a table for each fault, the one with the worst actuator first."""
    flights = f"{report.flights} flight{'s' if report.flights != 1 else ''}"
    faults = dict.fromkeys(one.fault for one in report.trends)
    return [
        Headline(f"{headline(report)} ({flights})"),
        *(_table([one for one in report.trends if one.fault == fault], report) for fault in faults),
        *([Note(lines)] if (lines := _reasons(report)) else []),
        Note([f"{capital(report.notice)}."], quiet=True),
    ]


def headline(report: TrendReport) -> str:
    """Return the result in one line: the shortest remaining useful life, or that none is known."""
    if not report.flights:
        return "No flights: keep them with mavhums analyse LOG --keep"
    last: list[ActuatorTrend | Standing] = [*report.trends, *report.others]
    if not last:
        return "No flight carries an indicator of a fault"
    by_name = {_subject(one): one for one in report.standings}
    states = [(one, _state(by_name.get(_subject(one)), one)) for one in last]
    gravest = max((state for _, state in states), key=URGENCY.__getitem__)
    growing = [one for one in report.trends if one.growth]
    grown = [f"{_title(one, report)} grows: {soonest_words(one.growth)}" for one in growing if one.growth]
    if SEVERITY[gravest] <= 0:
        return "; ".join(grown) or "No actuator shows wear towards a limit"
    worst = {_name(one, report): by_name.get(_subject(one)) for one, state in states if state == gravest}
    text = f"{join(worst)}: {gravest.upper()}"
    (first, *more) = worst.values()
    if more or first is None or first.since_flight is None or first.since_flight == first.flights:
        text += " in the last flight"
    else:
        text += f" {since_words(first)}"
    return "; ".join([text, *grown])


def _subject(one: ActuatorTrend | Standing) -> tuple[int, str]:
    return one.vehicle, one.actuator


def _state(standing: Standing | None, one: ActuatorTrend | Standing) -> Condition:
    """Return the state over the flights, where it is a fault, else the condition of the last flight."""
    faulty = standing is not None and SEVERITY[standing.condition] > 0
    return standing.condition if standing is not None and faulty else one.condition


def sparkline(values: Sequence[float]) -> str:
    """Draw values between their minimum and maximum; those of a long history are averaged in groups.

    Examples
    --------
    >>> sparkline([0.2, 0.2, 0.3, 0.6])
    '▁▁▃█'
    """
    means = [part.mean() for part in np.array_split(np.asarray(values), min(_CELLS, len(values)))]
    least, most = min(means), max(means)
    step = (most - least) / (len(_BARS) - 1) or 1.0
    return "".join(_BARS[round((mean - least) / step)] for mean in means)


def _table(trends: Sequence[ActuatorTrend], report: TrendReport) -> TableBlock:
    states = {_subject(one): one for one in report.standings}
    rows: list[list[Cell]] = []
    for one in trends:
        state = _by_indicator(_state(states.get(_subject(one)), one), one)
        grows = one.growth is not None and SEVERITY[state] <= 0
        values = one.points.estimate
        rows.append(
            [
                _name(one, report),
                [Mark("changed", "grows") if grows else Mark(state)],
                f"{sparkline(values)} {values[-1]:.3g}",
                _signed(one.change),
                _signed(one.per_flight),
            ]
        )
    columns = [Column(trends[0].subject), Column("state", "word"), Column("over the\nflights", "word")]
    columns += [Column(title, "figure") for title in ("since\nbaseline", "per\nflight")]
    return TableBlock(f"{trends[0].quantity}, {trends[0].unit}", columns, rows)


def _by_indicator(state: Condition, one: ActuatorTrend) -> Condition:
    """Return the state of a subject as far as this indicator gives it: another one is within its limit."""
    highest = one.points.highest[-1]
    passed = _beyond(one) or (highest is not None and one.limit is not None and highest > one.limit)
    return "normal" if one.limit is not None and not passed and SEVERITY[state] > 0 else state


def _signed(change: Interval | None) -> str:
    """Format a change with half its 95 % interval; for a change that may be zero, only the interval."""
    if change is None:
        return "—"
    half = (change.high - change.low) / 2
    digits = int(np.clip(-np.floor(np.log10(half)), 0, 9)) if half > 0 else 3
    estimate = f"{change.estimate:+.{digits}f}" if abs(change.estimate) > half else ""
    return f"{estimate}±{half:.{digits}f}"


def _reasons(report: TrendReport) -> list[str]:
    """Return reasons for an unknown remaining useful life, excluded flights, and what is not shown."""
    groups: dict[str, list[str]] = {}
    for one in report.trends:
        grows = one.per_flight is not None and one.per_flight.low > 0
        if one.reason and (grows or one.emergency is not None):
            groups.setdefault(one.reason, []).append(_title(one, report))
    lines = [f"{join(names)}: no remaining useful life (RUL): {reason}." for reason, names in groups.items()]
    for standing in report.standings:
        lines += [f"{standing.actuator}: {said}." for said in sentences(standing)]
    for one in report.trends:
        if one.left_out:
            flown = join(start[:16].replace("T", " ") for start in one.left_out)
            lines.append(f"{_title(one, report)}: outlier, left out of the trend line: {flown} UTC.")
    if report.repairs:
        repaired = join(f"{one.actuator or 'all actuators'} {one.at_utc[:10]}" for one in report.repairs)
        lines.append(f"Repaired: {repaired}; flights before that no longer count.")
    for other in report.others:
        why = f": {other.reason}" if other.reason else ""
        lines.append(f"{_name(other, report)}: {other.last} in the last flight{why}.")
    shown = {_subject(one) for one in report.trends} | {_subject(one) for one in report.others}
    silent: dict[tuple[str, str], list[Standing]] = {}
    for standing in report.standings:
        if _subject(standing) not in shown and standing.condition != "unmonitored":
            why = f"{standing.condition}: {standing.reason or 'no reason was given'}"
            silent.setdefault((standing.subject, why), []).append(standing)
    for (subject, why), alike in silent.items():
        whose = group_name(subject, [subject_of(subject, standing.actuator) for standing in alike])
        lines.append(f"{whose}: no indicator in any flight; in the last one {why}.")
    return lines


def _title(one: ActuatorTrend, report: TrendReport) -> str:
    several = len({other.fault for other in report.trends}) > 1
    return f"{_name(one, report)} ({one.fault})" if several else _name(one, report)


def _name(one: ActuatorTrend | Standing, report: TrendReport) -> str:
    name = one.actuator
    if len({other.vehicle for other in report.trends}) > 1:
        name = f"{one.vehicle}: {name}"
    if isinstance(one, ActuatorTrend) and len({other.airframe for other in report.trends}) > 1:
        name = f"{name} [{one.airframe}]"
    return name


_MAIN: Final = ("friction", *LOSSES)


class TrendView(NamedTuple):
    """A trend of an actuator or an axis, for a browser that draws it.

    Attributes
    ----------
    first
        Whether a reader must see it: friction, control, what grows, and what is beyond its limit.
    chart
        The curve. Its ``caption`` has the last value with its interval, the change and the slope, ``life``
        the growth with the flights left to each limit, or why there are none.
    """

    actuator: str
    first: bool
    chart: Chart


def trend_shown(trend: ActuatorTrend, prefix: str = "", repairs: Sequence[RepairDate] = ()) -> TrendView:
    """Return what is shown of a trend.

    Parameters
    ----------
    trend
        With at least one point.
    prefix
        Written before the actuator's name.
    repairs
        Of the aircraft; those of the actuator are marked.
    """
    points = trend.points
    days_ms = np.array([*map(_milliseconds, points.start_utc)])
    rows = np.column_stack([points.low, points.estimate, points.high])
    limits = [Limit(value, word) for value, word in _levels(trend)]
    unit = "" if trend.unit == "1" else f" {trend.unit}"
    title = f"{trend.quantity}{f', {unit.strip()}' if unit else ''}"
    marks = _marks(trend, repairs)
    caption = "; ".join([_trend_text(trend, unit), *(text for _, text in marks)])
    drawn = chart(Curve(days_ms, rows), limits, title, caption, whole=True) | {
        "life": _life(trend),
        "marks": [{"at": _milliseconds(at_utc), "text": text} for at_utc, text in marks],
        "flights": points.flight,
    }
    return TrendView(
        actuator=f"{prefix}{subject_of(trend.subject, trend.actuator)}",
        first=trend.fault in _MAIN or trend.growth is not None or _beyond(trend),
        chart=drawn,
    )


def _milliseconds(utc: str) -> float:
    return datetime.fromisoformat(utc).timestamp() * 1e3


def _marks(trend: ActuatorTrend, repairs: Sequence[RepairDate]) -> list[tuple[str, str]]:
    """Return the dates and names of the repairs since the first flight, and of the last step."""
    first = _milliseconds(trend.points.start_utc[0])
    marks = [
        (repair.at_utc, f"repair {repair.at_utc[:10]}")
        for repair in repairs
        if repair.actuator in (None, trend.actuator) and _milliseconds(repair.at_utc) > first
    ]
    step = trend.step
    flown = zip(trend.points.flight, trend.points.start_utc, strict=True)
    before = [start for flight, start in flown if step is not None and flight < step.flight]
    if step is not None and not any(at > before[-1] for at, _ in marks if before and at <= step.at_utc):
        marks.append((step.at_utc, f"step {step.at_utc[:10]}"))
    return marks


def _levels(trend: ActuatorTrend) -> list[tuple[float, str]]:
    return levels(trend.limit, trend.emergency, falls=_falls(trend))


def _beyond(trend: ActuatorTrend) -> bool:
    last = trend.points.last
    if trend.limit is None:
        return False
    return last.high < trend.limit if _falls(trend) else last.low > trend.limit


def _falls(trend: ActuatorTrend) -> bool:
    return trend.fault in LOSSES


def _trend_text(trend: ActuatorTrend, unit: str) -> str:
    points = trend.points
    parts = [f"flight {points.flight[-1]}: {_interval(points.last)}{unit}, 95 % interval"]
    if trend.change:
        parts.append(f"against its first flights {_interval(trend.change, sign='+')}{unit}")
    if trend.per_flight:
        parts.append(f"per flight {_interval(trend.per_flight, sign='+')}{unit}")
    parts += [f"{word} {value:.3g}" for value, word in _levels(trend)]
    parts += [f"{len(trend.left_out)} flights left out as outliers"] if trend.left_out else []
    return "; ".join(parts)


def _interval(value: Interval, sign: str = "") -> str:
    return f"{value.estimate:{sign}.3g} ({value.low:{sign}.3g} to {value.high:{sign}.3g})"


def _life(trend: ActuatorTrend) -> str:
    """Return growth with the flights left to each limit, else why it is not known; and the last step."""
    said = [growth_words(trend.growth)] if trend.growth else [capital(trend.reason or "no growth")]
    return ". ".join([*said, *([step_words(trend.step)] if trend.step else [])])
