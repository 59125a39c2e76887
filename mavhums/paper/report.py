"""The reports of the studies in Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import compress

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from mavhums.core.quantities import KEYS
from mavhums.learn import SubsetSearch
from mavhums.paper.cyclograms import (
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
from mavhums.paper.statements import (
    FASTER,
    POINT,
    decay_table,
    group_statement,
    named,
    statement_table,
)
from mavhums.paper.tables import FEWER_NETWORKS, LOAD_FRICTION, Findings

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
