"""The reports of the studies in Markdown, and the paper's as a Rerun recording.

The recording shows the result, the outputs of figures 16 to 19, and the quantities of figures 3 to 14.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import compress
from pathlib import Path

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb
from jinja2 import Environment, PackageLoader, StrictUndefined

from mavhums.core.quantities import KEYS, QUANTITIES
from mavhums.learn import SubsetSearch
from mavhums.paper.cyclograms import (
    BEST_SELECTED,
    CONDITIONS,
    FIGURES_16_TO_19,
    PILOT,
    SELECTED,
    TABLE_4,
    TABLE_5,
    TAKEOFF,
    TRAINING_NM,
    CyclogramSamples,
)
from mavhums.paper.experiment import WEIGHT_DECAY, Experiment, emergency, held_decision
from mavhums.paper.statements import (
    FASTER,
    POINT,
    decay_table,
    group_statement,
    named,
    statement_table,
)
from mavhums.paper.tables import FEWER_NETWORKS, LOAD_FRICTION, Findings
from mavhums.show._rows import open_stream, send
from mavhums.show.blueprint import panels, whole_flight
from mavhums.show.words import BLUE, COLOURS, SERIES

_HELD_GOAL = 99.9
_MOVES = 0.9


def render(template: str, **results: object) -> str:
    """Return a report: one of the package's templates, filled with results.

    A template writes a table by the filter ``table``, see :func:`markdown_table`.
    """
    made = Environment(
        loader=PackageLoader("mavhums.paper"),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters |= {"table": markdown_table, "chosen": compress}
    return made.get_template(template).render(results)


def report(findings: Findings, seconds: float) -> str:
    """Return the whole report.

    Parameters
    ----------
    findings
        Results of the study.
    seconds
        Computing time, s.
    """
    outputs = findings.takeoff[1].flights[["friction_nm", "role", "per_sample", "held"]].copy()
    outputs["friction_nm"] = [f"{friction:.3f}" for friction in outputs["friction_nm"]]
    return render(
        "paper.md.jinja",
        found=findings,
        effort=findings.effort,
        seconds=seconds,
        pilot=PILOT,
        takeoff=TAKEOFF,
        all_keys=KEYS,
        selected=SELECTED,
        best_selected=BEST_SELECTED,
        weight_decay=WEIGHT_DECAY,
        load_friction=LOAD_FRICTION,
        fewer_networks=FEWER_NETWORKS,
        statements=statement_table(findings),
        point=POINT,
        faster=FASTER,
        decays=decay_table(findings),
        group_statement=group_statement(findings.groups),
        split=pd.DataFrame(
            {
                "T_c, N·m": [f"{friction:.3f}" for friction in CONDITIONS],
                "sample": ["training" if friction in TRAINING_NM else "test" for friction in CONDITIONS],
                "class": [
                    "normal (0, 1)" if friction < 0.5 else "emergency (1, 0)" for friction in CONDITIONS
                ],
            }
        ),
        best=[_best(experiment) for experiment in findings.takeoff],
        summary=pd.DataFrame(
            [_summary(each) for name in (TAKEOFF, PILOT) for each in findings.experiments[name]]
        ),
        motion=_motion(findings),
        outputs=outputs,
        rank=_rank,
    )


def _best(experiment: Experiment) -> pd.DataFrame:
    """Return the five networks with the best test accuracy beside those that the paper published."""
    best = experiment.table.sort_values("test", ascending=False).head(5)
    published = {KEYS: TABLE_4, SELECTED: TABLE_5}.get(experiment.inputs, ())
    columns: dict[str, list[object]] = {}
    if published:
        ranked = sorted(published, key=lambda row: -row.test)[: len(best)]
        columns |= {
            "paper: hidden": [row.hidden for row in ranked],
            "training": [row.training for row in ranked],
            "test": [row.test for row in ranked],
        }
    columns |= {
        "ours: hidden": best["hidden"].tolist(),
        "training ": best["training"].tolist(),
        "test ": best["test"].tolist(),
    }
    return pd.DataFrame(columns)


def _summary(experiment: Experiment) -> dict[str, object]:
    test = experiment.table["test"]
    return {
        "cyclogram": experiment.cyclogram,
        "inputs": named(experiment.inputs),
        "best by test": experiment.best_test,
        "chosen without test data": experiment.without_test_data,
        "median": float(test.median()),
        "worst": float(test.min()),
        "mean of all networks": experiment.ensemble_test,
        "their spread (sd of P)": f"{experiment.ensemble_spread:.4f}",
        "training, processor s": round(experiment.seconds, 1),
        "iterations": round(experiment.iterations),
    }


def _motion(findings: Findings) -> pd.DataFrame:
    """Return the accuracies of each experiment beside the share of the time in which the actuator moves."""
    rows = []
    for name, experiments in findings.experiments.items():
        moving = float(findings.moving["mean"][findings.moving["cyclogram"] == name].iloc[0])
        for experiment in experiments:
            held, voted = experiment.test_mean("held"), experiment.test_mean("voted")
            reached = "yes" if held >= _HELD_GOAL else "no"
            rows.append(
                {
                    "cyclogram": name,
                    "moving": moving,
                    "inputs": named(experiment.inputs),
                    "per sample": experiment.without_test_data,
                    "held": held,
                    "voted": voted,
                    "worst flight, held": float(experiment.flights["held"].min()),
                    "before motion": int(experiment.flights["before_motion"].max()),
                    f"held ≥ {_HELD_GOAL}": "moves too little" if moving < _MOVES else reached,
                }
            )
    return pd.DataFrame(rows)


def _rank(search: SubsetSearch, keys: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[float, int]:
    """Return the score of a subset, and its rank among all, from 1."""
    score = search.scores[(search.subsets == np.isin(keys, inputs)).all(axis=1)][0]
    return score, 1 + int((search.scores > score).sum())


def markdown_table(table: pd.DataFrame, digits: int = 2) -> str:
    """Return a table in Markdown, numbers rounded.

    Examples
    --------
    >>> print(markdown_table(pd.DataFrame({"input": ["V2"], "test, %": [98.012]})))
    | input | test, % |
    |---|---|
    | V2 | 98.01 |
    """
    lines = [_row(table.columns), "|" + "---|" * len(table.columns)]
    lines += [
        _row(f"{cell:.{digits}f}" if isinstance(cell, float) else cell for cell in row)
        for row in table.itertuples(index=False)
    ]
    return "\n".join(lines)


def _row(cells: Iterable[object]) -> str:
    return f"| {' | '.join(str(cell) for cell in cells)} |"


_STATES = {state: COLOURS[state] for state in ("normal", "emergency")}


def record_study(
    path: Path, report: str, flights: Sequence[CyclogramSamples], experiments: Sequence[Experiment]
) -> None:
    """Write the recording of the take-off.

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
