"""The study as a Rerun recording: the result, the outputs of figures 16 to 19, the quantities of 3 to 14."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mavhums.core.quantities import KEYS, QUANTITIES
from mavhums.show._rows import open_stream, send
from mavhums.show.blueprint import panels, whole_flight
from mavhums.show.words import BLUE, COLOURS, SERIES
from mavhums.study.cyclograms import CyclogramSamples
from mavhums.study.experiment import Experiment, emergency, held_decision
from mavhums.study.published import FIGURES_16_TO_19

__all__ = ["record_study"]

_STATES = {state: COLOURS[state] for state in ("normal", "emergency")}


def record_study(
    path: Path, report: str, flights: Sequence[CyclogramSamples], experiments: Sequence[Experiment]
) -> None:
    """Write the recording of the main cyclogram.

    Parameters
    ----------
    path
        The ``.rrd`` file.
    report
        Markdown.
    flights
        Samples of all conditions.
    experiments
        Experiments on the same cyclogram, each with its network's output at every condition.
    """
    with open_stream("study-paper") as stream:
        stream.save(path, default_blueprint=_blueprint(flights, experiments))
        stream.send_recording_name("the paper's study")
        stream.log("report", rr.TextDocument(report, media_type="text/markdown"), static=True)
        for flown in flights:
            for place, key in enumerate(KEYS):
                entity = f"{_root(flown)}/{key}"
                stream.log(entity, rr.SeriesLines(names=key, colors=BLUE, widths=1.0), static=True)
                send(stream, entity, flown.time_s, rr.Scalars.columns(scalars=flown.values[:, place]))
            for number, experiment in enumerate(experiments):
                _log_output(stream, flown, experiment, SERIES[number % len(SERIES)])


def _log_output(
    stream: rr.RecordingStream, flown: CyclogramSamples, experiment: Experiment, colour: tuple[int, int, int]
) -> None:
    inputs = f"{len(experiment.inputs)}_inputs_{'_'.join(experiment.inputs)}"
    entity = f"{_root(flown)}/output/{inputs}"
    probability = experiment.outputs[flown.friction_nm]
    names = f"P(emergency), {_short(experiment)}"
    stream.log(entity, rr.SeriesLines(names=names, colors=colour, widths=1.0), static=True)
    send(stream, entity, flown.time_s, rr.Scalars.columns(scalars=probability))
    decision, decided = held_decision(probability > 0.5, flown.moving)
    changes = np.flatnonzero(decided & (np.diff(decision, prepend=not decision[0]) | ~np.roll(decided, 1)))
    held = _lane(flown, experiment)
    states = rr.StateConfiguration(
        values=list(_STATES), labels=list(_STATES), colors=[(*rgb, 255) for rgb in _STATES.values()]
    )
    stream.log(held, states, static=True)
    found = ["emergency" if decision[k] else "normal" for k in changes]
    send(stream, held, flown.time_s[changes], rr.StateChange.columns(state=found))


def _blueprint(flights: Sequence[CyclogramSamples], experiments: Sequence[Experiment]) -> rrb.Blueprint:
    left: list[rrb.View | rrb.Container] = []
    if experiments:
        lanes = [_lane(flown, experiment) for experiment in experiments for flown in _shown(flights)]
        title = "Network's decision, by inputs and friction: above 0.375 N·m it should be an emergency"
        left.append(rrb.StateTimelineView(origin="/", contents=lanes, name=title, time_view=whole_flight()))
    tabs = [_quantities(flown) for flown in sorted(flights, key=lambda flown: flown.friction_nm)]
    if experiments:
        tabs.insert(0, _outputs(flights))
    left.append(rrb.Tabs(*tabs, active_tab=0))
    share = min(0.08 + 0.042 * len(_shown(flights)) * len(experiments), 0.45)
    report = rrb.TextDocumentView(origin="report", name="Report")
    shares = [share, 1 - share] if experiments else None
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*left, row_shares=shares), report, column_shares=[2, 1]),
        *panels(),
        auto_views=False,
        auto_layout=False,
    )


def _outputs(flights: Sequence[CyclogramSamples]) -> rrb.Container:
    """Return figures 16 to 19."""
    figures = {friction: f"Fig. {number}: " for number, friction in FIGURES_16_TO_19.items()}
    shown = _shown(flights)
    plots = [
        rrb.TimeSeriesView(
            origin=f"{_root(flown)}/output",
            name=f"{figures.get(flown.friction_nm, '')}{_condition(flown)}",
            axis_x=whole_flight(),
            axis_y=rrb.ScalarAxis(range=(-0.05, 1.05)),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=flown is shown[0]),
        )
        for flown in shown
    ]
    return rrb.Grid(*plots, grid_columns=2, name="Network outputs: figures 16 to 19")


def _quantities(flown: CyclogramSamples) -> rrb.Container:
    """Return figures 3 to 14 of one condition."""
    plots = [
        rrb.TimeSeriesView(
            origin=f"{_root(flown)}/{quantity.key}",
            name=f"Fig. {3 + place}: {quantity.key} {quantity.name}, {quantity.unit}",
            axis_x=whole_flight(),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for place, quantity in enumerate(QUANTITIES)
    ]
    return rrb.Grid(*plots, grid_columns=3, name=_condition(flown))


def _shown(flights: Sequence[CyclogramSamples]) -> list[CyclogramSamples]:
    """Return those flights of figures 16 to 19 that exist, in order of friction."""
    shown = [flown for flown in flights if flown.friction_nm in FIGURES_16_TO_19.values()]
    return sorted(shown or flights[:4], key=lambda flown: flown.friction_nm)


def _condition(flown: CyclogramSamples) -> str:
    return f"{flown.friction_nm:.3f} N·m, {'emergency' if emergency(flown) else 'normal'}"


def _root(flown: CyclogramSamples) -> str:
    return f"friction_{round(1000 * flown.friction_nm):04d}"


def _lane(flown: CyclogramSamples, experiment: Experiment) -> str:
    return f"/decision/{_short(experiment).replace(' ', '_')}/{flown.friction_nm:.3f}"


def _short(experiment: Experiment) -> str:
    return "all twelve" if len(experiment.inputs) == len(KEYS) else " ".join(experiment.inputs)
