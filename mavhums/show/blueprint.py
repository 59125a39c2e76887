"""The layout of a recording: the answer first, the worst actuator below it, the others one click away."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from mavhums.assessment import Assessment, Verdict
from mavhums.quantities import QUANTITIES
from mavhums.show._tracks import ARCHETYPE, TIMELINE, actuator_path
from mavhums.show._words import name

__all__ = ["layout"]

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


def layout(assessment: Assessment, present: Mapping[str, frozenset[str]]) -> rrb.Blueprint:
    """Return the layout in which a recording opens.

    Parameters
    ----------
    assessment
        The verdicts, which say what is shown first.
    present
        What there is to draw, by the entity path of its actuator: the quantities that the log carries,
        ``friction`` and ``network``.
    """
    tabs = []
    for verdict in assessment.ranked():
        root = actuator_path(verdict.vehicle, verdict.actuator)
        if present.get(root):
            tabs.append(_actuator(root, present[root], f"{name(verdict, assessment)}: {_word(verdict)}"))
    events = rrb.TextLogView(origin="/events", name="Events")
    conditions = rrb.StateTimelineView(
        origin="/",
        contents=list(present),
        name="Condition of every actuator",
        time_view=_whole_flight(),
    )
    lanes = min(0.06 + 0.04 * len(present), 0.4)
    report = rrb.TextDocumentView(origin="/report", name="Report")
    left = rrb.Vertical(conditions, rrb.Tabs(*tabs, events, active_tab=0), row_shares=[lanes, 1 - lanes])
    return rrb.Blueprint(
        rrb.Horizontal(left, report, column_shares=[2, 1]),
        rrb.TimePanel(timeline=TIMELINE, play_state="paused", state="collapsed"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _word(verdict: Verdict) -> str:
    changed = verdict.worst != verdict.condition
    return f"{verdict.condition}, was {verdict.worst}" if changed else verdict.worst


def _actuator(root: str, keys: frozenset[str], tab: str) -> rrb.Container:
    answer = []
    if "friction" in keys:
        answer.append(_plot("Friction, N·m, against its limits", [f"{root}/friction", f"{root}/limits"]))
    if "network" in keys:
        title = "Network: probability of emergency"
        answer.append(_plot(title, [f"{root}/network"], legend=False, span=(-0.05, 1.05)))
    groups = [(subject, [key for key in members if key in keys]) for subject, members in _PLOTS]
    signals = [_signals(root, subject, found) for subject, found in groups if found]
    rows: list[rrb.Container] = []
    if answer:
        rows.append(rrb.Horizontal(*answer, column_shares=[2, 1][: len(answer)]))
    if signals:
        rows.append(rrb.Grid(*signals, grid_columns=min(3, len(signals))))
    return rrb.Vertical(*rows, row_shares=[1, 2] if len(rows) == 2 else None, name=tab)


def _signals(root: str, subject: str, keys: list[str]) -> rrb.TimeSeriesView:
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
    return _plot(title, [path], legend=len(keys) > 1, overrides={path: lines})


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
    *,
    legend: bool = True,
    span: tuple[float, float] | None = None,
    overrides: Mapping[rr.EntityPath | str, list[rrb.Visualizer]] | None = None,
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin="/",
        contents=contents,
        name=title,
        axis_x=_whole_flight(),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        overrides=overrides,
    )


def _whole_flight() -> rrb.TimeAxis:
    """Return an axis of its own for each plot: linked ones would open on 30 s around the cursor."""
    everything = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.TimeAxis(view_range=everything)
