"""The trend of an indicator over flights: its curve and its words."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.conditions import Condition
from mavhums.health.axis.past import LOSSES
from mavhums.results.standing import ActuatorTrend, Interval, RepairDate
from mavhums.show.evidence import Limit
from mavhums.show.html_curves import Curve
from mavhums.show.html_plot import Chart, chart
from mavhums.show.standing import growth_words, step_words
from mavhums.show.words import capital

__all__ = ["TrendShown", "trend_shown"]

_MAIN: Final = ("friction", *LOSSES)


class TrendShown(NamedTuple):
    """A trend: its title, its numbers in words, its curve, and the remaining useful life.

    Attributes
    ----------
    actuator, condition
        Whose trend it is, and its gravest condition in the last flight, of whatever indicator.
    told
        The last value with its interval, the change and the slope.
    life
        Growth with the flights left to each limit, or why there are none.
    first
        Whether a reader must see it: friction, control, what grows, and what is beyond its limit.
    """

    actuator: str
    condition: Condition
    title: str
    told: str
    life: str
    first: bool
    chart: Chart


def trend_shown(trend: ActuatorTrend, prefix: str = "", repairs: Sequence[RepairDate] = ()) -> TrendShown:
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
    days_ms = np.array([_milliseconds(point.start_utc) for point in trend.points])
    rows = np.array([[one.value.low, one.value.estimate, one.value.high] for one in trend.points])
    limits = [Limit(value, word) for value, word in _levels(trend)]
    unit = "" if trend.unit == "1" else f" {trend.unit}"
    title = f"{trend.quantity}{f', {unit.strip()}' if unit else ''}"
    marks = _marks(trend, repairs)
    told = "; ".join([_told(trend, unit), *(text for _, text in marks)])
    drawn = chart(Curve(days_ms, rows), limits, title, told, whole=True)
    drawn["marks"] = [{"at": _milliseconds(at_utc), "text": text} for at_utc, text in marks]
    drawn["flights"] = [point.flight for point in trend.points]
    drawn["starts"] = [point.start_utc for point in trend.points]
    return TrendShown(
        actuator=f"{prefix}{trend.actuator}{' control' if trend.subject == 'axis' else ''}",
        condition=trend.condition,
        title=title,
        told=told,
        life=_life(trend),
        first=trend.fault in _MAIN or trend.growth is not None or _beyond(trend),
        chart=drawn,
    )


def _milliseconds(utc: str) -> float:
    return datetime.fromisoformat(utc).timestamp() * 1e3


def _marks(trend: ActuatorTrend, repairs: Sequence[RepairDate]) -> list[tuple[str, str]]:
    """Return the dates and names of the repairs since the first flight, and of the last step."""
    first = _milliseconds(trend.points[0].start_utc)
    marks = [
        (repair.at_utc, f"repair {repair.at_utc[:10]}")
        for repair in repairs
        if repair.actuator in (None, trend.actuator) and _milliseconds(repair.at_utc) > first
    ]
    step = trend.step
    before = [one.start_utc for one in trend.points if step is not None and one.flight < step.flight]
    if step is not None and not any(at > before[-1] for at, _ in marks if before and at <= step.at_utc):
        marks.append((step.at_utc, f"step {step.at_utc[:10]}"))
    return marks


def _levels(trend: ActuatorTrend) -> list[tuple[float, str]]:
    """Return the limits and their names; a control gain falls as a fault grows."""
    words = ("degraded below", "emergency up to") if _falls(trend) else ("degraded above", "emergency from")
    levels = zip((trend.limit, trend.emergency), words, strict=True)
    return [(value, word) for value, word in levels if value is not None]


def _beyond(trend: ActuatorTrend) -> bool:
    last = trend.points[-1].value
    if trend.limit is None:
        return False
    return last.high < trend.limit if _falls(trend) else last.low > trend.limit


def _falls(trend: ActuatorTrend) -> bool:
    return trend.fault in LOSSES


def _told(trend: ActuatorTrend, unit: str) -> str:
    last = trend.points[-1]
    parts = [f"flight {last.flight}: {_interval(last.value)}{unit}, 95 % interval"]
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
