"""The study's report in Markdown: the paper's results beside ours, and the causes of differences."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from mavhums.core.quantities import KEYS
from mavhums.learn import Scheme
from mavhums.study.cyclograms import MAIN, TAKEOFF
from mavhums.study.experiment import Experiment
from mavhums.study.findings import Findings, differences, first_table
from mavhums.study.published import (
    CONDITIONS,
    SELECTED,
    TABLE_4,
    TABLE_5,
    TRAINING_NM,
    PublishedNetwork,
)
from mavhums.study.tables import FEWER_NETWORKS, LOAD_FRICTION

__all__ = ["markdown_table", "report"]

_HELD_GOAL = 99.9
_MOVES = 0.9


def report(findings: Findings, seconds: float) -> str:
    """Return the whole report.

    Parameters
    ----------
    findings
        Results of the study.
    seconds
        Computing time, s.
    """
    return (
        "\n\n".join(
            [
                _opening(findings, seconds),
                _conditions(findings),
                _figure_15(findings),
                _figure_1(findings),
                _tables_4_and_5(findings),
                _cyclograms(findings),
                *((_wrappers(findings), _thinning(findings)) if findings.subsets else ()),
                _outputs(findings),
                _load_friction(findings),
            ]
        )
        + "\n"
    )


def _opening(findings: Findings, seconds: float) -> str:
    effort = findings.effort
    parts = [first_table(findings, name) for name in (TAKEOFF, MAIN)]
    return f"""# The paper's study, repeated

S. Bazhenov, A. Skryabin, G. Veresnikov: *The Development of Algorithms for EMA Fault Early Detection
System*. Everything here is simulated; it is not an airworthiness decision.

`mavhums study paper`, seed {findings.seed}, {effort.networks} networks per experiment, {effort.iterations}
iterations of L-BFGS with weight decay 1e-4, {"every sample" if effort.every == 1 else "some samples"} of the
training flights. Computed in {seconds:.0f} s.
{"" if effort.networks >= 50 else "**A quick run: a preview, whose numbers should not be quoted.**"}

{markdown_table(pd.concat(parts, ignore_index=True))}

The paper chose its best networks on the test set. For ours the table gives both choices; "chosen without
test data" is the network with the smallest training loss. "{TAKEOFF}" is the paper's cyclogram as far as its
figures show it; "{MAIN}" is ours.

{differences(findings)}"""


def _figure_1(findings: Findings) -> str:
    parts = [
        "## Figure 1: the whole scheme",
        "The stages of `mavhums train`, from the two training flights to one network. The wrapper and"
        " the choice of the network see blocks of time held out of those flights; no stage sees a "
        "test flight.",
    ]
    for name, found in findings.figure_1.items():
        stages = "\n".join(found.stages)
        parts.append(
            f"### {name}\n\n```\n{stages}\n```\n\nThe network on {' '.join(found.inputs)} classifies "
            f"{found.test:.2f} % of the test samples right."
        )
    return "\n\n".join(parts)


def _conditions(findings: Findings) -> str:
    split = pd.DataFrame(
        {
            "T_c, N·m": [f"{friction:.3f}" for friction in CONDITIONS],
            "sample": ["training" if friction in TRAINING_NM else "test" for friction in CONDITIONS],
            "class": ["normal (0, 1)" if friction < 0.5 else "emergency (1, 0)" for friction in CONDITIONS],
        }
    )
    own, mixed = findings.leaks
    return f"""## The actuator and the conditions

Table 1, and the characteristics of the simulated actuator:

{markdown_table(findings.table_1, 3)}

The split. The paper's second table 1 lists 1.025 N·m as a test condition, but its text trains on it; only
the split below gives 20,000 training and 60,000 test samples. Each flight is entirely in one set.

{markdown_table(split)}

All eight conditions use the same command at the same sample times, so the command cannot reveal the class:
Cramér's V of V1 and class is {own.cramers_v:.3f}{" (**leak**)" if own.leaks else ""}. The same check on
classes flown with different cyclograms gives {mixed.cramers_v:.3f} and
{"warns" if mixed.leaks else "does not warn"}.

Figures 3 to 14: V1–V12 at T_c = 0.225 N·m, cyclogram "{MAIN}".

![Figures 3 to 14](figures-3-14.png)"""


def _figure_15(findings: Findings) -> str:
    found = findings.groupings[MAIN]
    filters = pd.DataFrame(
        [
            {"filter": "paper", "groups": "4 groups (a picture)", "selected": ", ".join(SELECTED)},
            {
                "filter": f"Algorithm 1, m = {Scheme().order}, R² ≥ {Scheme().r2}",
                "groups": _groups(found.algorithm_1),
                "selected": ", ".join(found.selected),
            },
            {
                "filter": "pairs, degree 2, R² ≥ 0.9",
                "groups": _groups(found.pairwise),
                "selected": ", ".join(found.pairwise_selected),
            },
        ]
    )
    others = pd.DataFrame(
        [
            {"cyclogram": name, "groups": _groups(other.algorithm_1), "selected": ", ".join(other.selected)}
            for name, other in findings.groupings.items()
        ]
    )
    models = "\n".join(f"- `{text}` (R² {r2:.5f})" for text, r2 in found.expressions)
    return f"""## Figure 15: chi-square and groups

{markdown_table(findings.chi_square, 1)}

Agreement: V2 = V3, V5 = V8 and V7 = V10 exactly, because each pair is the same signal in different units; V4,
V5, V6 and V8 rank far above V7 and V10, which rank above V12 and V11.
Unavoidable differences: with two classes the statistic cannot exceed the number of samples, so 41,807 needs
more than the 20,000 training samples. A command that is the same for both classes scores exactly 0, so 40,590
for V1 needs commands that differ between the classes. The paper's data therefore probably reveal the class in
the command, and in V2 and V3, which follow it. Ours do not; V1, V2 and V3 alone carry almost no information.
V9 ranks higher here: in the paper it ranks after V4, V5, V6 and V8.

The paper's p-levels by degrees of freedom (dof): the p-level of V12 agrees with 11 dof (12 bins), that of V11
with none of those tried.

{markdown_table(findings.p_levels, 6)}

### Groups of interdependent quantities

{markdown_table(filters)}

Algorithm 1 by cyclogram:

{markdown_table(others)}

The models by which Algorithm 1 excludes quantities, in order of exclusion (the smallest set of regressors
that reaches the threshold; terms below a thousandth of the target's standard deviation are omitted):

{models}"""


def _groups(groups: tuple[tuple[str, ...], ...]) -> str:
    return " ".join("{" + ", ".join(group) + "}" for group in groups)


def _tables_4_and_5(findings: Findings) -> str:
    twelve = findings.main[0]
    parts = [
        "## Tables 4 and 5: fifty networks",
        "The five best networks by test accuracy (the paper's convention). Accuracies in %.",
    ]
    for experiment in findings.main:
        published = TABLE_4 if experiment.inputs == KEYS else TABLE_5 if experiment.inputs == SELECTED else ()
        parts += [
            f"### {len(experiment.inputs)} inputs: {', '.join(experiment.inputs)}",
            _best(experiment, published),
        ]
    summary = pd.DataFrame([_summary(experiment) for experiment in findings.main])
    parts += ["### All networks", markdown_table(summary)]
    for experiment in findings.main[1:]:
        iterations = experiment.table["iterations"].mean() / twelve.table["iterations"].mean()
        parts.append(
            f"Training {len(experiment.inputs)} inputs ({', '.join(experiment.inputs)}) took "
            f"{experiment.seconds / twelve.seconds:.2f} times the processor time of 12 inputs and "
            f"{iterations:.2f} times the iterations."
        )
    return "\n\n".join(parts)


def _best(experiment: Experiment, published: tuple[PublishedNetwork, ...]) -> str:
    best = experiment.best_five
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
    return markdown_table(pd.DataFrame(columns))


def _summary(experiment: Experiment) -> dict[str, object]:
    test = experiment.table["test"]
    return {
        "inputs": " ".join(experiment.inputs),
        "best by test": float(test.max()),
        "chosen without test data": experiment.without_test_data,
        "median": float(test.median()),
        "worst": float(test.min()),
        "mean of all networks": experiment.ensemble_test,
        "their spread (sd of P)": f"{experiment.ensemble_spread:.4f}",
        "training, processor s": round(experiment.seconds, 1),
        "iterations": round(float(experiment.table["iterations"].mean())),
    }


def _cyclograms(findings: Findings) -> str:
    rows = []
    for name, experiments in findings.experiments.items():
        moving = float(findings.moving["mean"][findings.moving["cyclogram"] == name].iloc[0])
        for experiment in experiments:
            held, voted = experiment.test_mean("held"), experiment.test_mean("voted")
            rows.append(
                {
                    "cyclogram": name,
                    "moving": moving,
                    "inputs": " ".join(experiment.inputs) if experiment.inputs != KEYS else "12",
                    "per sample": experiment.without_test_data,
                    "held": held,
                    "voted": voted,
                    "worst flight, held": float(experiment.flights["held"].min()),
                    "before motion": int(experiment.flights["before_motion"].max()),
                    f"held ≥ {_HELD_GOAL}": _verdict(moving, held),
                }
            )
    table = pd.DataFrame(rows)
    return f"""## Four cyclograms: accuracy and motion

A stationary actuator gives no evidence of friction, so motion limits the accuracy of a decision per sample.
*Held*: during standstill the last decision at 1 °/s or more is held, causally; samples before the first
motion are not counted, and the table gives their largest number per flight. *Voted*: the majority of the
last 100 moving samples. Test flights, network chosen without test data, %.

{markdown_table(table)}

Moving fraction of each flight:

{markdown_table(findings.moving, 3)}

![Accuracy against moving fraction](accuracy-against-moving-fraction.png)"""


def _verdict(moving: float, held: float) -> str:
    if moving < _MOVES:
        return "moves too little"
    return "yes" if held >= _HELD_GOAL else "no"


def _wrappers(findings: Findings) -> str:
    parts = [
        "## Subset search",
        "Validation uses blocks of time held out of the training flights. Test accuracy is given only for "
        "comparison; no choice uses it.",
    ]
    for keys, (table, search, genetic) in findings.subsets.items():
        parts.append(f"### {len(search.scores)} subsets of {', '.join(keys) if keys != KEYS else 'V1–V12'}")
        best = ", ".join(key for key, used in zip(keys, search.best, strict=True) if used)
        parts += [f"Best by validation: {best} ({100 * search.score:.2f} %).", markdown_table(table)]
        if genetic is not None:
            rank = {
                subset.tobytes(): score for subset, score in zip(search.subsets, search.scores, strict=True)
            }
            for name, inputs in (
                ("the paper's", SELECTED),
                ("Algorithm 1's", findings.groupings[MAIN].selected),
            ):
                mask = pd.Index(keys).isin(inputs)
                score = rank[mask.tobytes()]
                place = 1 + int((search.scores > score).sum())
                parts.append(f"{name.capitalize()} {', '.join(inputs)}: {100 * score:.2f} %, rank {place}.")
            parts.append(
                f"The genetic algorithm, on the same table, found {100 * genetic.score:.2f} % in "
                f"{len(genetic.scores)} evaluations of {len(search.scores)}."
            )
    return "\n\n".join(parts)


def _thinning(findings: Findings) -> str:
    return f"""## Redundant vectors

Networks on {", ".join(SELECTED)}, trained on thinned precedents: the median test accuracy of ten networks, %;
mean and standard deviation over five seeds. The reference is random thinning to the same size.

{markdown_table(findings.thinning)}"""


def _outputs(findings: Findings) -> str:
    theirs = findings.main[2]
    table = theirs.flights[["friction_nm", "role", "per_sample", "held"]].copy()
    table["friction_nm"] = [f"{friction:.3f}" for friction in table["friction_nm"]]
    return f"""## Figures 16 to 19: the network over the cyclogram

Inputs {", ".join(theirs.inputs)}, network chosen without test data. As in the paper, accuracy is lowest for
the conditions nearest to the limits, 0.375 and 0.875 N·m.

![Figures 16 to 19](figures-16-19.png)

{markdown_table(table)}"""


def _load_friction(findings: Findings) -> str:
    own, loaded = findings.groupings[MAIN], findings.load_grouping
    networks = min(findings.effort.networks, FEWER_NETWORKS)
    return f"""## Friction that grows with the load

The paper's friction does not depend on the load. A real servo's does: T_f = T_c + μ·|load|, μ about
{LOAD_FRICTION:g} on a bench. The same flights with that μ; {networks} networks a row, the one with the
smallest training loss, test flights, %.

{markdown_table(findings.load_friction)}

On "{MAIN}" Algorithm 1 selects {", ".join(loaded.selected)} at μ {LOAD_FRICTION:g}, and
{", ".join(own.selected)} at μ 0."""


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
