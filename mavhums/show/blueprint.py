"""The layout of a recording: the result first, the worst actuator below it, the others in tabs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from mavhums.core.conditions import Condition
from mavhums.core.quantities import QUANTITIES
from mavhums.show._signals import ARCHETYPE, TIMELINE
from mavhums.show.event_words import in_order
from mavhums.show.words import SERIES

_PLOTS: Final = (
    ("angle", ("V1", "V3")),
    ("supply current", ("V5",)),
    ("supply voltage", ("V4",)),
    ("power", ("V6", "V9", "V12")),
    ("rotor speed", ("V7",)),
    ("rotor torque", ("V8",)),
    ("output speed", ("V10",)),
    ("output torque", ("V11",)),
    ("rotor rotation", ("V2",)),
)
_QUANTITIES = {quantity.key: quantity for quantity in QUANTITIES}
_EFFECTIVENESS_SPAN: Final = (-0.2, 1.8)
_MAP_PIXELS: Final = 100
_LIVE_SIGNALS_S, _LIVE_EVIDENCE_S = 30, 120


class Lane(NamedTuple):
    """One actuator in the layout.

    Attributes
    ----------
    root
        Its root entity path.
    title
        Its name, with its vehicle if there are several.
    condition, worst
        Its current and its worst condition.
    present
        Data to draw: the quantities in the log, and ``network``.
    faults
        Indicators by fault: what each shows, and its entity path.
    cause
        The fault that caused the worst condition; its plot is in front.
    traces
        What lies behind the judgement, by its kind, in the same form.
    states
        Entity path of its conditions; the root if empty.
    """

    root: str
    title: str
    condition: Condition
    worst: Condition
    present: frozenset[str]
    faults: Mapping[str, tuple[str, str]] = {}
    cause: str = "friction"
    traces: Mapping[str, tuple[str, str]] = {}
    states: str = ""


class _TimeRange(NamedTuple):
    """The time range of plots; conditions are always shown from the start."""

    signals: rrb.TimeAxis
    evidence: rrb.TimeAxis


class Surroundings(NamedTuple):
    """Views besides those of the actuators.

    Attributes
    ----------
    modes
        Entity paths of flight modes.
    airframe
        Entity path of the displayed airframe; None without a profile.
    positions
        Entity paths of positions.
    extent_deg
        Extent of the map; None if not known yet.
    """

    modes: tuple[str, ...] = ()
    airframe: str | None = None
    positions: tuple[str, ...] = ()
    extent_deg: float | None = None


def layout(lanes: Sequence[Lane], around: Surroundings | None = None, *, live: bool = False) -> rrb.Blueprint:
    """Return the layout of a recording.

    Parameters
    ----------
    lanes
        The actuators, worst first.
    around
        The other views.
    live
        Whether the views follow the newest data instead of showing the whole flight.
    """
    axes = (
        _TimeRange(_latest(_LIVE_SIGNALS_S), _latest(_LIVE_EVIDENCE_S))
        if live
        else _TimeRange(*[_whole_flight()] * 2)
    )
    tabs = [_actuator(lane, axes) for lane in lanes if lane.present or lane.faults or lane.traces]
    around = around or Surroundings()
    middle = _vehicle(around)
    below = rrb.Horizontal(rrb.Tabs(*tabs, active_tab=0), middle, column_shares=[5, 3]) if tabs else middle
    rows = len(lanes) + len(around.modes)
    share = min(0.08 + 0.042 * rows, 0.5)
    conditions = rrb.StateTimelineView(
        origin="/",
        contents=[*around.modes, *(lane.states or lane.root for lane in lanes)],
        name="Condition of every axis and actuator",
        time_view=_whole_flight(),
    )
    views = rrb.Vertical(conditions, below, row_shares=[share, 1 - share])
    report = rrb.TextDocumentView(origin="/report", name="Report")  # there is none before the end
    return rrb.Blueprint(
        views if live else rrb.Horizontal(views, report, column_shares=[3, 1]),
        # The viewer's own panels, minimised, with the cursor at the end of the flight.
        rrb.TimePanel(timeline=TIMELINE, play_state="following", state="collapsed"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _vehicle(around: Surroundings) -> rrb.Container:
    """Return the middle views: airframe, map and events."""
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    events = rrb.TextLogView(origin="/events", name="Events: click one to go there", columns=columns)
    views: list[rrb.View] = []
    if around.airframe:
        behind = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(-1.75, 0.55, 1.15),
            look_target=(-0.2, 0, 0),
            eye_up=(0, 0, 1),
        )
        below = rr.components.Plane3D.XY.with_distance(-0.7)
        ground = rrb.LineGrid3D(visible=True, spacing=0.5, plane=below, color=(90, 94, 104, 160))
        views.append(
            rrb.Spatial3DView(
                origin=around.airframe,
                name="Airframe, seen from behind",
                eye_controls=behind,
                background=(24, 26, 32),
                line_grid=ground,
            )
        )
    if around.positions:
        contents = [f"{path}/**" for path in around.positions]
        views.append(rrb.MapView(origin="/", contents=contents, name="Where it was", zoom=_zoom(around)))
    shares = [*([3] if around.airframe else []), *([2] if around.positions else []), 2]
    return rrb.Vertical(*views, events, row_shares=shares)


def _zoom(around: Surroundings) -> float | None:
    """Return the zoom level that shows the whole track; level 0 shows the world in 256 pixels."""
    if around.extent_deg is None:
        return None
    degrees_per_pixel = max(around.extent_deg, 1e-3) / _MAP_PIXELS
    return float(np.clip(np.log2(360 / 256 / degrees_per_pixel), 1, 18))


def _tab(lane: Lane) -> str:
    changed = lane.worst != lane.condition
    return f"{lane.title}: {lane.condition}" + (f", was {lane.worst}" if changed else "")


def _actuator(lane: Lane, axes: _TimeRange) -> rrb.Container:
    root, keys = lane.root, lane.present
    faults = _faults(lane, axes.evidence)
    answer: list[rrb.View | rrb.Container] = [rrb.Tabs(*faults, active_tab=0)] if faults[1:] else [*faults]
    traces = (lane.traces[kind] for kind in in_order(lane.traces, lane.cause))
    behind = [_plot(title, [path], axes.evidence) for title, path in traces]
    answer[:0] = behind[:1]
    if "network" in keys:
        answer.append(_network(root, axes.evidence))
    groups = [(subject, [key for key in members if key in keys]) for subject, members in _PLOTS]
    signals = [_signals(root, subject, found, axes.signals) for subject, found in groups if found]
    signals += behind[1:]
    rows: list[rrb.Container] = []
    if answer:
        rows.append(rrb.Horizontal(*answer, column_shares=[3, 2, 2][: len(answer)]))
    if signals:
        rows.append(rrb.Grid(*signals, grid_columns=min(3, len(signals))))
    return rrb.Vertical(
        *rows, row_shares=[1, 1 if lane.traces else 2] if len(rows) == 2 else None, name=_tab(lane)
    )


def _network(root: str, axis: rrb.TimeAxis) -> rrb.Container:
    """Return the network's answer: the classes, and behind them the probability of a fault."""
    contents = [f"{root}/network", f"{root}/network/samples"]
    plot = _plot("P(fault)", contents, axis, legend=True, span=(-0.05, 1.05))
    lane = rrb.StateTimelineView(
        origin="/",
        contents=[f"{root}/network/class"],
        name="Network: classes",
        time_view=axis,
    )
    return rrb.Tabs(lane, plot, active_tab=0)


def _faults(lane: Lane, axis: rrb.TimeAxis) -> list[rrb.View]:
    """Return the plots of fault indicators with limits: the causing fault first, then friction."""
    order = sorted(lane.faults, key=lambda fault: (fault != lane.cause, fault != "friction", fault))
    return [
        _plot(title, [path], axis, span=_EFFECTIVENESS_SPAN if fault == "effectiveness" else None)
        for fault in order
        for title, path in (lane.faults[fault],)
    ]


def _signals(root: str, subject: str, keys: list[str], axis: rrb.TimeAxis) -> rrb.TimeSeriesView:
    path = f"{root}/quantities"
    lines = [
        rr.SeriesLines(names=_short(key), colors=colour, widths=1.0).visualizer(mappings=[_source(key)])
        for key, colour in zip(keys, SERIES, strict=False)
    ]
    title = f"{', '.join(keys)} {subject}, {_QUANTITIES[keys[0]].unit}"
    return _plot(title, [path], axis, legend=len(keys) > 1, overrides={path: lines})


def _short(key: str) -> str:
    """Return a short name, such as ``V9 rotor`` for the rotor shaft power; the plot's unit adds the rest."""
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


def _whole_flight() -> rrb.TimeAxis:
    """Return a separate axis for each plot: linked axes would open at 30 s around the cursor."""
    everything = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.TimeAxis(view_range=everything)


def _latest(seconds: int) -> rrb.TimeAxis:
    """Return an axis that ends at the cursor, which follows the flight."""
    start = rr.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    end = rr.TimeRangeBoundary.cursor_relative(seconds=0)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
