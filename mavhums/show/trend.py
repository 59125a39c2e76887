"""The trend over flights for the terminal: one line per actuator, worst first, and reasons below."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.results.standing import ActuatorTrend, Growth, Interval, LastFlight, Standing, TrendReport
from mavhums.show.standing import left_words, sentences, since_words, soonest_words
from mavhums.show.words import COLOURS, join, printable

__all__ = ["render_trends", "sparkline"]

_BARS = "▁▂▃▄▅▆▇█"
_CELLS = 8


def render_trends(report: TrendReport, console: Console) -> None:
    """Print a report for a person; a table for each fault, the one with the worst actuator first."""
    flights = f"{report.flights} flight{'s' if report.flights != 1 else ''}"
    console.print(Text(printable(headline(report)), style="bold"), Text(f"({flights})", style="dim"))
    for fault in dict.fromkeys(one.fault for one in report.trends):
        shown = [one for one in report.trends if one.fault == fault]
        console.print(_table(shown, report))
    for line in _reasons(report):
        console.print(Padding(Text(printable(line)), (0, 0, 0, 2), expand=False))
    console.print(Text(f"{report.notice[:1].upper()}{report.notice[1:]}.", style="dim"))


def headline(report: TrendReport) -> str:
    """Return the result in one line: the shortest remaining useful life, or that none is known."""
    if not report.flights:
        return "No flights in this folder: put them there with mavhums analyse LOG --history DIR --keep"
    last: list[ActuatorTrend | LastFlight] = [*report.trends, *report.others]
    if not last:
        return "No flight in this folder carries an indicator of a fault"
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


def _subject(one: ActuatorTrend | LastFlight | Standing) -> tuple[int, str]:
    return one.vehicle, one.actuator


def _state(standing: Standing | None, one: ActuatorTrend | LastFlight) -> Condition:
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


def _table(trends: Sequence[ActuatorTrend], report: TrendReport) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=0, pad_edge=False)
    table.title = Text(printable(f"{trends[0].quantity}, {trends[0].unit}"))
    table.title_justify = "left"
    table.add_column(trends[0].subject, overflow="fold", min_width=13)
    table.add_column("state", no_wrap=True)
    table.add_column("over the\nflights", no_wrap=True)
    for heading in ("since\nbaseline", "per\nflight", "flights to\nnext limit"):
        table.add_column(heading, justify="right", no_wrap=True)
    states = {_subject(one): one for one in report.standings}
    for one in trends:
        state = _state(states.get(_subject(one)), one)
        red, green, blue = COLOURS["changed" if state == "normal" and one.growth else state]
        word = "grows" if one.growth and SEVERITY[state] <= 0 else state
        values = [point.value.estimate for point in one.points]
        table.add_row(
            Text(printable(_name(one, report))),
            Text(word, style=f"rgb({red},{green},{blue})"),
            f"{sparkline(values)} {values[-1]:.3g}",
            _signed(one.change),
            _signed(one.per_flight),
            _left(one.growth),
        )
    return table


def _peak(one: ActuatorTrend, report: TrendReport) -> str | None:
    """Return the highest estimate of the last flight and the one at its end, if the flight was faulty.

    The mean over the flight, which the table has, may lie below the limit that was passed.
    """
    point = one.points[-1]
    if point.highest is None or one.limit is None or point.highest <= one.limit or point.flight < one.flights:
        return None
    unit = "" if one.unit == "1" else f" {one.unit}"
    end = "" if point.end is None else f", {point.end:.3g}{unit} at its end"
    highest = f"{_title(one, report)}: up to {point.highest:.3g}{unit} in the last flight{end}"
    return f"{highest}; {point.value.estimate:.3g}{unit} is its mean."


def _signed(change: Interval | None) -> str:
    """Format a change with half its 95 % interval; for a change that may be zero, only the interval."""
    if change is None:
        return "—"
    half = (change.high - change.low) / 2
    digits = int(np.clip(-np.floor(np.log10(half)), 0, 9)) if half > 0 else 3
    estimate = f"{change.estimate:+.{digits}f}" if abs(change.estimate) > half else ""
    return f"{estimate}±{half:.{digits}f}"


def _left(growth: Growth | None) -> str:
    """Format the flights left to the next limit; — where nothing grows, or no limit is ahead."""
    ahead = [each for each in (growth.to_degraded, growth.to_emergency) if each] if growth else []
    left = next((each for each in ahead if each.estimate > 0), None)
    if left is None:
        return "—"
    text = left_words(left, dates=False).replace("more than ", ">")
    return text.replace(" flights", "").replace(" flight", "")


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
        told = join(f"{one.actuator or 'all actuators'} {one.at_utc[:10]}" for one in report.repairs)
        lines.append(f"Repaired: {told}; flights before that no longer count.")
    lines += [said for one in report.trends if (said := _peak(one, report))]
    for other in report.others:
        why = f": {other.reason}" if other.reason else ""
        lines.append(f"{_name(other, report)}: {other.condition} in the last flight{why}.")
    if report.unshown:
        lines.append(f"{join(report.unshown)}: no flight carries an indicator; `mavhums analyse` says why.")
    return lines


def _title(one: ActuatorTrend, report: TrendReport) -> str:
    several = len({other.fault for other in report.trends}) > 1
    return f"{_name(one, report)} ({one.fault})" if several else _name(one, report)


def _name(one: ActuatorTrend | LastFlight, report: TrendReport) -> str:
    name = one.actuator
    if len({other.vehicle for other in report.trends}) > 1:
        name = f"{one.vehicle}: {name}"
    if isinstance(one, ActuatorTrend) and len({other.airframe for other in report.trends}) > 1:
        name = f"{name} [{one.airframe}]"
    return name
