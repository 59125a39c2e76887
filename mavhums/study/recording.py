"""The study as one Rerun recording: quantities, network outputs, accuracies, and the report itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mavhums.quantities import KEYS
from mavhums.study.cyclograms import Flown
from mavhums.study.experiment import Experiment, emergency, held_decision

__all__ = ["record_study"]

_TIMELINE = "flight_time"
_STATES = {"normal": (0, 158, 115), "emergency": (213, 94, 0)}


def record_study(
    path: Path, report: str, flights: Sequence[Flown], experiments: Sequence[Experiment]
) -> None:
    """Write the recording of the main cyclogram.

    Parameters
    ----------
    path
        The ``.rrd`` file.
    report
        Markdown.
    flights
        All conditions.
    experiments
        Of the same cyclogram; each with its network's output at every condition.
    """
    with rr.RecordingStream("mavhums", recording_id="study-paper", send_properties=False) as stream:
        stream.set_log_tick_enabled(False)
        stream.set_log_time_enabled(False)
        stream.save(path, default_blueprint=_blueprint(flights, experiments))
        stream.send_recording_name("the paper's study")
        stream.log("report", rr.TextDocument(report, media_type="text/markdown"), static=True)
        for flown in flights:
            index = [rr.TimeColumn(_TIMELINE, duration=_nanoseconds(flown.time_s))]
            for place, key in enumerate(KEYS):
                entity = f"{_root(flown)}/{key}"
                stream.log(entity, rr.SeriesLines(names=key), static=True)
                content = rr.Scalars.columns(scalars=flown.values[:, place])
                stream.send_columns(entity, indexes=index, columns=content, strict=True)
            for experiment in experiments:
                _log_output(stream, flown, experiment, index)


def _log_output(
    stream: rr.RecordingStream, flown: Flown, experiment: Experiment, index: list[rr.TimeColumn]
) -> None:
    entity = f"{_root(flown)}/output/{_inputs(experiment)}"
    probability = experiment.outputs[flown.friction_nm]
    stream.log(entity, rr.SeriesLines(names=f"P(emergency), {_inputs(experiment)}"), static=True)
    content = rr.Scalars.columns(scalars=probability)
    stream.send_columns(entity, indexes=index, columns=content, strict=True)
    decision, decided = held_decision(probability > 0.5, flown.moving)
    changes = np.flatnonzero(decided & (np.diff(decision, prepend=not decision[0]) | ~np.roll(decided, 1)))
    held = f"{_root(flown)}/held/{_inputs(experiment)}"
    states = rr.StateConfiguration(
        values=list(_STATES), labels=list(_STATES), colors=[(*rgb, 255) for rgb in _STATES.values()]
    )
    stream.log(held, states, static=True)
    stream.send_columns(
        held,
        indexes=[rr.TimeColumn(_TIMELINE, duration=_nanoseconds(flown.time_s[changes]))],
        columns=rr.StateChange.columns(state=["emergency" if decision[k] else "normal" for k in changes]),
        strict=True,
    )


def _blueprint(flights: Sequence[Flown], experiments: Sequence[Experiment]) -> rrb.Blueprint:
    everything = rrb.TimeRangeBoundary.infinite()
    axis = rrb.TimeAxis(view_range=rr.TimeRange(start=everything, end=everything))
    tabs: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="report", name="Report")]
    for flown in flights:
        root = _root(flown)
        views: list[rrb.View | rrb.Container] = [
            rrb.Grid(
                *(rrb.TimeSeriesView(origin=f"{root}/{key}", name=key, axis_x=axis) for key in KEYS),
                grid_columns=3,
            ),
            rrb.TimeSeriesView(origin=f"{root}/output", name="network output", axis_x=axis),
        ]
        if experiments:
            views.append(rrb.StateTimelineView(origin=f"{root}/held", name="held decision", time_view=axis))
        wanted = "emergency" if emergency(flown) else "normal"
        name = f"{flown.friction_nm:.3f} N·m, {wanted}"
        tabs.append(rrb.Vertical(*views, row_shares=[4, 1.5, 1][: len(views)], name=name))
    return rrb.Blueprint(rrb.Tabs(*tabs), rrb.TimePanel(timeline=_TIMELINE, play_state="paused"))


def _root(flown: Flown) -> str:
    return f"friction_{round(1000 * flown.friction_nm):04d}"


def _inputs(experiment: Experiment) -> str:
    return f"{len(experiment.inputs)}_inputs_{'_'.join(experiment.inputs)}"


def _nanoseconds(time_s: NDArray[np.float64]) -> NDArray[np.timedelta64]:
    return np.rint(time_s * 1e9).astype(np.int64).astype("timedelta64[ns]")
