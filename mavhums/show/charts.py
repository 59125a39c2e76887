"""The curves of a flight and the trends of an aircraft as JSON, for a browser that draws them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.show.evidence import Evidence, Limit
from mavhums.show.html_curves import Curve, Gathered
from mavhums.show.html_plot import gaps, value_range
from mavhums.show.words import printable

__all__ = ["Chart", "chart", "flight_charts"]

_DIGITS: Final = 4  # significant ones: more cannot be seen, and double what is sent
_LETTERS: Final = 600

Chart = dict[str, Any]


def flight_charts(shown: Iterable[Evidence], gathered: Gathered, duration_s: float) -> Chart:
    """Return a flight's curves, its modes by vehicle, and its track.

    Parameters
    ----------
    shown
        The evidence, in the order in which it is drawn.
    gathered
        Has the flight modes and the track.
    duration_s
        Of the flight.
    """
    charts = []
    for one in shown:
        drawn = chart(one.curve, one.limits, one.title, one.told)
        drawn["since"] = one.since_s
        drawn["vehicle"] = one.vehicle
        charts.append(drawn)
    modes = {vehicle: _spans(several, duration_s) for vehicle, several in gathered.modes.items()}
    return {"duration": duration_s, "charts": charts, "modes": modes, "tracks": gathered.tracks()}


def chart(curve: Curve, limits: Sequence[Limit], title: str, told: str, *, whole: bool = False) -> Chart:
    """Return a curve as columns; a row of nulls stands where nothing is known.

    Parameters
    ----------
    curve
        Over seconds, or over whatever its times are.
    limits
        Levels that it is compared with.
    title, told
        What it shows: in short, and in words for who does not see it.
    whole
        Whether a long time without a value is no gap, as between two flights.
    """
    cuts = [] if whole else [part.start for part in gaps(curve.time_s)][1:]
    low, high = value_range(curve, [limit.value for limit in limits])
    columns = zip(("low", "value", "high"), curve.rows.T, strict=True)
    drawn: Chart = {
        "title": _text(title),
        "told": _text(told),
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


def _spans(modes: Sequence[tuple[float, str]], end_s: float) -> list[tuple[float, float, str]]:
    """Return begin, end and name of each flight mode."""
    ends = [*(begin for begin, _ in modes[1:]), end_s]
    return [(begin, end, _text(mode)) for (begin, mode), end in zip(modes, ends, strict=True)]


def _numbers(values: Array) -> list[float | None]:
    return [float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None for value in values.tolist()]


def _text(text: str) -> str:
    return printable(text)[:_LETTERS]
