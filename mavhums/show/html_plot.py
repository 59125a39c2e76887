"""A curve with its interval and limits: the parts of an inline SVG, and JSON for a browser that draws it.

A style sheet colours the SVG; matplotlib would fix the colours, which here follow light, dark and paper, and
is not in the base install.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from math import ceil, floor, log10
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.core.output import no_formula, printable
from mavhums.show.curves import Curve
from mavhums.show.evidence import CaptionedCurve, Limit
from mavhums.show.words import clock

if TYPE_CHECKING:
    import pandas as pd

_DIGITS: Final = 4  # significant ones: more cannot be seen, and double what is sent
_LETTERS: Final = 600

WIDTH, HEIGHT = 640, 240
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 112, 10, 46
_LETTER: Final = 8.5  # width
_LINE: Final = 20.0  # between two labels, for the larger letters of a phone
_GAP_S: Final = 3.0
_TIME_STEPS: Final = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 36000)

Chart = dict[str, Any]
_Scale = Callable[[Array], Array]


class Tick(NamedTuple):
    """A mark of an axis: its place on the drawing, and its text."""

    at: float
    text: str


class Span(NamedTuple):
    """A part of the time axis on the drawing, and its text; none where there is no room for it."""

    left: float
    right: float
    text: str = ""


class Plot(NamedTuple):
    """What a template draws: paths, marks and levels, in the drawing's units.

    Attributes
    ----------
    band, line, demand, samples
        SVG paths of the interval, of the value, of what it should follow, and of the single samples that it
        sums up; empty if nothing.
    x, y
        Marks of the axes.
    limits
        Levels: their place and name.
    labels
        Where the names are: beside the curve, and apart from one another.
    since
        Place of the onset; None without one.
    reference
        Where the reference was learned; None without one.
    modes, events
        Below the curve: the flight modes, and what happened.
    """

    band: str
    line: str
    x: tuple[Tick, ...]
    y: tuple[Tick, ...]
    limits: tuple[Tick, ...]
    since: float | None
    labels: tuple[Tick, ...] = ()
    demand: str = ""
    samples: str = ""
    reference: Span | None = None
    modes: tuple[Span, ...] = ()
    events: tuple[Tick, ...] = ()
    left: int = _LEFT
    right: int = WIDTH - _RIGHT
    top: int = _TOP
    bottom: int = HEIGHT - _BOTTOM


def plot(shown: CaptionedCurve, duration_s: float) -> Plot:
    """Return the drawing of a curve.

    Parameters
    ----------
    shown
        With at least one row; all of its limits are inside the drawing.
    duration_s
        Of the flight: the time axis shows all of it.
    """
    curve, limits, since_s = shown.curve, shown.limits, shown.since_s
    end_s = max(duration_s, float(curve.time_s[-1]), 1.0)
    low, high = value_range(curve, [limit.value for limit in limits])

    def x(seconds: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return np.round(_LEFT + np.asarray(seconds) / end_s * (WIDTH - _LEFT - _RIGHT), 1)

    def y(values: NDArray[np.float64] | float) -> NDArray[np.float64]:
        share = (np.clip(values, low, high) - low) / (high - low)
        return np.round(HEIGHT - _BOTTOM - share * (HEIGHT - _TOP - _BOTTOM), 1)

    def span(begin: float, end: float, text: str = "") -> Span:
        left, right = x(np.array([begin, min(end, end_s)])).tolist()
        return Span(left, right, text if len(text) * _LETTER < right - left else "")

    band, line, demand = [], [], []
    for part in gaps(curve.time_s):
        at, rows = x(curve.time_s[part]), y(curve.rows[part])
        outline = np.concatenate([rows[:, 0], rows[::-1, 2]])
        if (rows[:, 0] != rows[:, 2]).any():
            band.append(_path(np.concatenate([at, at[::-1]]), outline) + "Z")
        line.append(_path(at, rows[:, 1]))
        if curve.demanded is not None:
            asked = curve.demanded[part]
            known = np.isfinite(asked)
            demand += [_path(at[known], y(asked[known]))] if known.any() else []
    steps = _steps(low, high)
    digits = max(0, -floor(log10(steps[1] - steps[0]))) if len(steps) > 1 else 2
    return Plot(
        band="".join(band),
        line="".join(line),
        x=tuple(Tick(float(x(at)), text) for at, text in _times(end_s)),
        y=tuple(Tick(float(y(v)), f"{v:z.{digits}f}") for v in steps),
        limits=tuple(Tick(float(y(limit.value)), limit.name) for limit in limits),
        since=None if since_s is None else float(x(min(since_s, end_s))),
        labels=tuple(_apart([Tick(float(y(limit.value)), limit.label) for limit in limits])),
        demand="".join(demand),
        reference=shown.reference_s and span(*shown.reference_s),
        modes=tuple(span(*mode) for mode in _spans(shown.modes, end_s)),
        events=tuple(Tick(float(x(at_s)), text) for at_s, text in shown.events),
        samples="" if curve.samples is None else "".join(_samples(curve.samples, x, y)),
    )


def _samples(samples: Array, x: _Scale, y: _Scale) -> Iterator[str]:
    """Yield the path of single samples, as a line that crosses wherever neighbours differ."""
    for part in gaps(samples[0]):
        yield _path(x(samples[0][part]), y(samples[1][part]))


def _apart(labels: Sequence[Tick]) -> Iterator[Tick]:
    """Yield labels from the top, each at its level or as near below it as the one before leaves room."""
    below = float(_TOP)
    for label in sorted(labels, key=lambda one: one.at):
        below = max(label.at, below)
        yield Tick(below, label.text)
        below += _LINE


def value_range(curve: Curve, levels: Sequence[float]) -> tuple[float, float]:
    """Return what a drawing shows: every value and level, and of very wide intervals a part."""
    rows, levels = curve.rows, [*levels]
    if curve.demanded is not None:
        levels += curve.demanded[np.isfinite(curve.demanded)].tolist()
    if curve.samples is not None:
        levels += [float(curve.samples[1].min()), float(curve.samples[1].max())]
    middle = rows[:, 1]
    low = min(float(np.percentile(rows[:, 0], 2)), float(middle.min()), 0.0, *levels)
    high = max(float(np.percentile(rows[:, 2], 98)), float(middle.max()), *levels)
    room = 0.05 * (high - low) or 1.0
    return (low - room if low < 0 else low), high + room


def _times(end_s: float) -> list[tuple[float, str]]:
    every = next((step for step in _TIME_STEPS if end_s / step <= 6), _TIME_STEPS[-1] * ceil(end_s / 2e5))
    return [(at, clock(at).replace(".0s", "s")) for at in np.arange(0, end_s, every).tolist()]


def _steps(low: float, high: float) -> list[float]:
    """Return three to six round values inside a range."""
    rough = (high - low) / 4
    power = 10.0 ** floor(log10(rough))
    step = min((factor * power for factor in (1, 2, 5, 10)), key=lambda one: abs(one - rough))
    return [k * step for k in range(ceil(low / step), floor(high / step) + 1)]


def gaps(time_s: NDArray[np.float64]) -> list[slice]:
    """Return the parts of a curve between which nothing is known."""
    steps = np.diff(time_s)
    usual = 4 * float(np.median(steps)) if steps.size else 0.0
    cuts = [0, *(np.flatnonzero(steps > max(_GAP_S, usual)) + 1).tolist(), time_s.size]
    return [slice(a, b) for a, b in pairwise(cuts)]


def _path(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    points = [f"{a:g} {b:g}" for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    if len(points) == 1:
        points.append(f"{x[0] + 1:g} {y[0]:g}")
    return f"M{'L'.join(points)}"


def flight_charts(shown: Iterable[CaptionedCurve], duration_s: float) -> Chart:
    """Return a flight's curves, and by vehicle its modes and events.

    Parameters
    ----------
    shown
        The evidence, in the order in which it is drawn.
    duration_s
        Of the flight.
    """
    charts, modes, events = [], {}, {}
    for one in shown:
        modes[one.vehicle] = _spans(one.modes, duration_s)
        events[one.vehicle] = [(at_s, _text(text)) for at_s, text in one.events]
        more = {"since": one.since_s, "reference": one.reference_s, "vehicle": one.vehicle}
        charts.append(chart(one.curve, one.limits, one.title, one.caption) | more)
    return {"duration": duration_s, "charts": charts, "modes": modes, "events": events}


def chart(curve: Curve, limits: Sequence[Limit], title: str, caption: str, *, whole: bool = False) -> Chart:
    """Return a curve as columns; a row is null where nothing is known.

    Parameters
    ----------
    curve
        Over seconds, or over whatever its times are.
    limits
        Levels that it is compared with.
    title, caption
        What it shows: in short, and in words for who does not see it.
    whole
        Whether a long time without a value is no gap, as between two flights.
    """
    cuts = [] if whole else [part.start for part in gaps(curve.time_s)][1:]
    low, high = value_range(curve, [limit.value for limit in limits])
    columns = zip(("low", "value", "high"), curve.rows.T, strict=True)
    drawn: Chart = {
        "title": _text(title),
        "caption": _text(caption),
        "range": [low, high],
        "limits": [{"value": one.value, "name": one.name, "label": one.label} for one in limits],
        "time": np.insert(np.round(curve.time_s, 2), cuts, curve.time_s[cuts]).tolist(),
        **{name: _numbers(np.insert(column, cuts, np.nan)) for name, column in columns},
    }
    if curve.demanded is not None:
        drawn["demanded"] = _numbers(np.insert(curve.demanded, cuts, np.nan))
    if curve.samples is not None:
        times, values = curve.samples
        apart = [part.start for part in gaps(times)][1:]
        drawn["samples"] = {
            "time": np.insert(np.round(times, 2), apart, times[apart]).tolist(),
            "value": _numbers(np.insert(values, apart, np.nan)),
        }
    return drawn


def curve_table(charts: Iterable[Chart]) -> pd.DataFrame:
    """Return curves as a table: a row for each time and curve, with its title and its levels in words."""
    import pandas as pd

    parts = []
    for one in charts:
        names = [name for name in ("time", "low", "value", "high", "demanded") if name in one]
        rows = pd.DataFrame({name: one[name] for name in names}).dropna(subset="value")
        levels = "; ".join(f"{limit['name']} {limit['value']:.4g}" for limit in one["limits"])
        parts.append(rows.assign(curve=no_formula(one["title"]), limits=levels))
    columns = ["curve", "time", "low", "value", "high", "demanded", "limits"]
    whole = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
    return whole.reindex(columns=columns).rename(columns={"time": "time_s"})


def _spans(modes: Sequence[tuple[float, str]], end_s: float) -> list[tuple[float, float, str]]:
    """Return begin, end and name of each flight mode."""
    ends = [*(begin for begin, _ in modes[1:]), end_s]
    return [(begin, end, _text(mode)) for (begin, mode), end in zip(modes, ends, strict=False)]


def _numbers(values: Array) -> list[float | None]:
    return [float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None for value in values.tolist()]


def _text(text: str) -> str:
    return printable(text)[:_LETTERS]
