"""The reports of the studies in Markdown, and the paper's statements, judged over weight decay."""

from __future__ import annotations

from typing import Final

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from mavhums.core.quantities import KEYS
from mavhums.paper.cyclograms import (
    BEST_12,
    BEST_SELECTED,
    CONDITIONS,
    PILOT,
    SELECTED,
    TABLE_4,
    TABLE_5,
    TAKEOFF,
    TRAINING_NM,
)
from mavhums.paper.experiment import WEIGHT_DECAY, Experiment
from mavhums.paper.tables import FEWER_NETWORKS, LOAD_FRICTION, Findings

POINT: Final = 0.5
"""A figure is confirmed within so many points, an order of accuracies where it holds by so many."""
FASTER: Final = 2 / 3
"""Of the time of twelve inputs that four take where learning counts as significantly faster."""

_NEAREST = ((0.375, (0.225, 0.275, 0.325)), (0.875, (0.925, 0.975, 1.025)))

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
    made.filters["table"] = markdown_table
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


def markdown_table(table: pd.DataFrame, digits: int = 2) -> str:
    """Return a table in Markdown, numbers rounded.

    Examples
    --------
    >>> print(markdown_table(pd.DataFrame({"input": ["V2"], "test, %": [98.012]})))
    | input | test, % |
    | --- | --- |
    | V2 | 98.01 |
    """
    body = [
        [f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell) for cell in row]
        for row in table.itertuples(index=False)
    ]
    rows = [map(str, table.columns), ["---"] * len(table.columns), *body]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def decay_table(findings: Findings) -> pd.DataFrame:
    """Return the accuracies of tables 4 and 5 by cyclogram, inputs and weight decay, %."""
    rows = []
    for (cyclogram, decay), experiments in findings.decays.items():
        for found in experiments:
            test = found.table["test"]
            rows.append(
                {
                    "cyclogram": cyclogram,
                    "inputs": named(found.inputs),
                    "weight decay": f"{decay:g}",
                    f"best of {len(test)} by test": found.best_test,
                    "chosen without test data": found.without_test_data,
                    "median": float(test.median()),
                }
            )
    return pd.DataFrame(rows).sort_values(["cyclogram", "inputs"], ascending=[False, True])


def statement_table(findings: Findings) -> pd.DataFrame:
    """Return the paper's statements on its networks, what the take-off shows, and the verdict."""
    rows: dict[str, dict[float, tuple[bool, str]]] = {}
    for (cyclogram, decay), (twelve, four, _) in findings.decays.items():
        if cyclogram == TAKEOFF:
            smaller = findings.subsets_of_four[decay]
            for statement, shown in _judged(twelve, four, smaller).items():
                rows.setdefault(statement, {})[decay] = shown
    return pd.DataFrame(
        [
            {"the paper says": statement}
            | {f"decay {decay:g}": text for decay, (_, text) in shown.items()}
            | {"verdict": _verdict([right for right, _ in shown.values()], "weight decay")}
            for statement, shown in rows.items()
        ]
    )


def _judged(
    twelve: Experiment, four: Experiment, subsets: dict[tuple[str, ...], float]
) -> dict[str, tuple[bool, str]]:
    """Return whether each statement holds, and the figure that shows it."""
    best, other, gain = twelve.best_test, four.best_test, four.best_test - twelve.best_test
    whole = subsets[SELECTED]
    inputs, without = max(((s, x) for s, x in subsets.items() if s != SELECTED), key=lambda one: one[1])
    time = four.seconds / twelve.seconds
    neurons = [int(table["hidden"].iloc[table["test"].argmax()]) for table in (twelve.table, four.table)]
    accuracy = four.flights.set_index("friction_nm")["per_sample"]
    lowest = all(accuracy[limit] <= accuracy[list(others)].min() for limit, others in _NEAREST)
    return {
        f"V1–V12 reach {BEST_12:.2f} %": (abs(best - BEST_12) <= POINT, f"{best:.2f}"),
        f"V2 V5 V9 V11 reach {BEST_SELECTED:.2f} %": (abs(other - BEST_SELECTED) <= POINT, f"{other:.2f}"),
        f"these four gain {BEST_SELECTED - BEST_12:.2f} points": (gain >= POINT, f"{gain:+.2f}"),
        "the maximum needs all four": (
            whole - without >= POINT,
            f"{whole - without:+.2f} on {' '.join(inputs)}",
        ),
        "four learn significantly faster": (time <= FASTER, f"{time:.2f} of the time"),
        "fewer neurons suffice (16, then 14)": (neurons[1] < neurons[0], "{}, then {}".format(*neurons)),
        "accuracy is lowest at 0.375 and 0.875 N·m": (lowest, "yes" if lowest else "no"),
    }


def group_statement(groups: pd.DataFrame) -> str:
    """Return the verdict on the paper's four groups, from which it selects V2, V5, V9 and V11."""
    paper = groups["cyclogram"] == TAKEOFF
    right = (groups["number"] == len(SELECTED)) & (groups["selected"] == ", ".join(SELECTED))
    return _verdict(right[paper].tolist(), "settings of the filter")


def _verdict(right: list[bool], setting: str) -> str:
    if len(set(right)) == 1:
        return "confirmed" if right[0] else "not confirmed"
    return f"depends on the {setting}"


def named(inputs: tuple[str, ...]) -> str:
    """Return the names of inputs."""
    return " ".join(inputs) if inputs != KEYS else "V1–V12"
