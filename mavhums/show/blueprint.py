"""The layout of a recording: the answer first, the worst actuator below it, the others one click away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from mavhums.assessment import Condition
from mavhums.quantities import QUANTITIES
from mavhums.show._stream import TIMELINE
from mavhums.show._tracks import ARCHETYPE

__all__ = ["Lane", "layout", "whole_flight"]

_PLOTS: Final = (
    ("angle", ("V1", "V3")),
    ("current", ("V5",)),
    ("voltage", ("V4",)),
    ("power", ("V6", "V9", "V12")),
    ("rotor speed", ("V7",)),
    ("rotor torque", ("V8",)),
    ("output shaft speed", ("V10",)),
    ("output shaft torque", ("V11",)),
    ("rotor rotation", ("V2",)),
)
_COLOURS = ((86, 180, 233), (240, 228, 66), (204, 121, 167))
_QUANTITIES = {quantity.key: quantity for quantity in QUANTITIES}
_LIVE_SIGNALS_S, _LIVE_EVIDENCE_S = 30, 120


class Lane(NamedTuple):
    """One actuator, as the layout must know it.

    Attributes
    ----------
    root
        The entity path under which all of it lies.
    title
        Its name, with its vehicle where there are several.
    condition, worst
        What it is now, and the worst it was.
    present
        What there is to draw: the quantities that the log carries, ``friction`` and ``network``.
    """

    root: str
    title: str
    condition: Condition
    worst: Condition
    present: frozenset[str]


class _Axes(NamedTuple):
    """The time that plots show; conditions are always shown from the start."""

    signals: rrb.TimeAxis
    evidence: rrb.TimeAxis


def layout(lanes: Sequence[Lane], *, live: bool = False) -> rrb.Blueprint:
    """Return the layout in which a recording opens.

    Parameters
    ----------
    lanes
        The actuators, the worst first.
    live
        Whether the views follow the newest data instead of showing the whole flight.
    """
    axes = (
        _Axes(_latest(_LIVE_SIGNALS_S), _latest(_LIVE_EVIDENCE_S)) if live else _Axes(*[whole_flight()] * 2)
    )
    tabs = [_actuator(lane, axes) for lane in lanes if lane.present]
    events = rrb.TextLogView(origin="/events", name="Events")
    conditions = rrb.StateTimelineView(
        origin="/",
        contents=[lane.root for lane in lanes],
        name="Condition of every actuator",
        time_view=whole_flight(),
    )
    share = min(0.06 + 0.04 * len(lanes), 0.4)
    report = rrb.TextDocumentView(origin="/report", name="Report")
    left = rrb.Vertical(conditions, rrb.Tabs(*tabs, events, active_tab=0), row_shares=[share, 1 - share])
    return rrb.Blueprint(
        rrb.Horizontal(left, report, column_shares=[2, 1]),
        rrb.TimePanel(timeline=TIMELINE, play_state="following" if live else "paused", state="collapsed"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _tab(lane: Lane) -> str:
    changed = lane.worst != lane.condition
    return f"{lane.title}: {lane.condition}" + (f", was {lane.worst}" if changed else "")


def _actuator(lane: Lane, axes: _Axes) -> rrb.Container:
    root, keys = lane.root, lane.present
    answer = []
    if "friction" in keys:
        contents = [f"{root}/friction", f"{root}/limits"]
        answer.append(_plot("Friction, N·m, against its limits", contents, axes.evidence))
    if "network" in keys:
        title = "Network: probability of emergency"
        answer.append(_plot(title, [f"{root}/network"], axes.evidence, legend=False, span=(-0.05, 1.05)))
    groups = [(subject, [key for key in members if key in keys]) for subject, members in _PLOTS]
    signals = [_signals(root, subject, found, axes.signals) for subject, found in groups if found]
    rows: list[rrb.Container] = []
    if answer:
        rows.append(rrb.Horizontal(*answer, column_shares=[2, 1][: len(answer)]))
    if signals:
        rows.append(rrb.Grid(*signals, grid_columns=min(3, len(signals))))
    return rrb.Vertical(*rows, row_shares=[1, 2] if len(rows) == 2 else None, name=_tab(lane))


def _signals(root: str, subject: str, keys: list[str], axis: rrb.TimeAxis) -> rrb.TimeSeriesView:
    path = f"{root}/quantities"
    lines = [
        rr.SeriesLines(names=_short(key), colors=colour, widths=1.0).visualizer(mappings=[_source(key)])
        for key, colour in zip(keys, _COLOURS, strict=False)
    ]
    first = _QUANTITIES[keys[0]]
    if len(keys) == 1:
        title = f"{first.key} {first.name}, {first.unit}"
    else:
        title = f"{', '.join(_short(key) for key in keys)} {subject}, {first.unit}"
    return _plot(title, [path], axis, legend=len(keys) > 1, overrides={path: lines})


def _short(key: str) -> str:
    """Return ``V9 rotor`` for the rotor shaft power: the unit's plot says the rest."""
    return f"{key} {_QUANTITIES[key].name.split()[0]}"


def _source(key: str) -> VisualizerComponentMapping:
    return VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=f"{ARCHETYPE}:{key}",
    )


def _plot(
    title: str,
    contents: list[str],
    axis: rrb.TimeAxis,
    *,
    legend: bool = True,
    span: tuple[float, float] | None = None,
    overrides: Mapping[rr.EntityPath | str, list[rrb.Visualizer]] | None = None,
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin="/",
        contents=contents,
        name=title,
        axis_x=axis,
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        overrides=overrides,
    )


def whole_flight() -> rrb.TimeAxis:
    """Return an axis of its own for each plot: linked ones would open on 30 s around the cursor."""
    everything = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.TimeAxis(view_range=everything)


def _latest(seconds: int) -> rrb.TimeAxis:
    """Return an axis that ends at the cursor, which follows the flight."""
    start = rr.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    end = rr.TimeRangeBoundary.cursor_relative(seconds=0)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
