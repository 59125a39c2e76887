"""The computations of the study; they write no files."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import pandas as pd

from mavhums.core.quantities import KEYS
from mavhums.learn import (
    CommandLeak,
    CommandLeakWarning,
    Scheme,
    SubsetSearch,
    check_command,
    train_network,
)
from mavhums.study.cyclograms import CYCLOGRAMS, MAIN, TAKEOFF, CyclogramSamples, fly_condition
from mavhums.study.experiment import Bound, Effort, Experiment, run_experiment, samples, takeoff_bound
from mavhums.study.published import BEST_12, BEST_SELECTED, CONDITIONS, SELECTED, TEST_NM, TRAINING_NM
from mavhums.study.tables import (
    LOAD_FRICTION,
    Grouping,
    chi_square_table,
    grouping,
    load_friction_table,
    p_level_table,
    subset_table,
    table_1,
    thinning_table,
)

__all__ = ["TWO", "FigureOne", "Findings", "Progress", "differences", "find", "first_table"]

Progress = Callable[[int, int], None]


TWO = ("V5", "V11")
"""The current and the load: what the torque balance needs besides the direction of motion."""

_BOTH = (MAIN, TAKEOFF)


@dataclass(frozen=True)
class FigureOne:
    """The scheme of figure 1, run from the training flights of one cyclogram to a network.

    Attributes
    ----------
    stages
        A line for each stage.
    inputs
        Of the network that was chosen.
    test
        Its accuracy on the test flights, %, which no stage saw.
    """

    stages: tuple[str, ...]
    inputs: tuple[str, ...]
    test: float


@dataclass(frozen=True, eq=False)
class Findings:
    """All results in the report.

    Attributes
    ----------
    groupings
        Feature groups, by cyclogram.
    experiments
        Experiments, by cyclogram. The inputs on the main one: all 12, Algorithm 1's, the paper's,
        the pairwise filter's; on the others the first three of these.
    subsets
        Subset searches, by the quantities searched: best rows, exhaustive search, and genetic
        search or None.
    leaks
        Command leak in the study's own data, and in classes flown with different cyclograms.
    load_friction, load_grouping
        Networks on an actuator whose friction grows with the load, and its feature groups on the main one.
    """

    effort: Effort
    seed: int
    table_1: pd.DataFrame
    chi_square: pd.DataFrame
    p_levels: pd.DataFrame
    groupings: dict[str, Grouping]
    experiments: dict[str, list[Experiment]]
    figure_1: dict[str, FigureOne]
    bound: Bound | None
    subsets: dict[tuple[str, ...], tuple[pd.DataFrame, SubsetSearch, SubsetSearch | None]]
    thinning: pd.DataFrame
    leaks: tuple[CommandLeak, CommandLeak]
    moving: pd.DataFrame
    load_friction: pd.DataFrame
    load_grouping: Grouping

    @property
    def main(self) -> list[Experiment]:
        """The experiments on the main cyclogram."""
        return self.experiments[MAIN]


def find(effort: Effort, *, seed: int, progress: Progress | None = None) -> Findings:
    """Compute the study.

    Parameters
    ----------
    effort
        Size of the computations.
    seed
        Seed of the networks and of random draws; the flights are fixed.
    progress
        Called with the number of steps done and the total.
    """
    training = {name: fly_condition(name, TRAINING_NM) for name in CYCLOGRAMS}
    test = fly_condition(MAIN, TEST_NM)
    groupings = {name: grouping(flights) for name, flights in training.items()}
    plan = [
        (name, inputs)
        for name, found in groupings.items()
        for inputs in dict.fromkeys(
            (
                KEYS,
                found.selected,
                SELECTED,
                *((found.pairwise_selected,) if name == MAIN else ()),
                *((TWO,) if name in _BOTH else ()),
            )
        )
    ]
    searched = (
        list(dict.fromkeys((SELECTED, groupings[MAIN].selected, KEYS))) if effort.subset_samples else []
    )
    steps = len(plan) + len(searched) + len(_BOTH) + 2
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, steps)

    run_experiment(MAIN, KEYS, replace(Effort.quick(), networks=2, iterations=2), seed=seed)  # warms up
    experiments: dict[str, list[Experiment]] = {name: [] for name in CYCLOGRAMS}
    for name, inputs in plan:
        experiments[name].append(run_experiment(name, inputs, effort, seed=seed))
        step()
    figure_1 = {}
    for name in _BOTH:
        figure_1[name] = _figure_1(name, effort, seed=seed)
        step()
    subsets = {}
    for keys in searched:
        subsets[keys] = subset_table(training[MAIN], test, keys, effort, seed=seed)
        step()
    thinning = thinning_table(training[MAIN], test, effort, seed=seed)
    step()
    loaded = load_friction_table(effort, seed=seed)
    step()
    return Findings(
        effort=effort,
        seed=seed,
        table_1=table_1(),
        chi_square=chi_square_table(training[MAIN], fly_condition(MAIN, CONDITIONS)),
        p_levels=p_level_table(),
        groupings=groupings,
        experiments=experiments,
        figure_1=figure_1,
        bound=takeoff_bound(effort) if effort.takeoffs else None,
        subsets=subsets,
        thinning=thinning,
        leaks=_leaks(training),
        moving=_moving(),
        load_friction=loaded,
        load_grouping=grouping(fly_condition(MAIN, TRAINING_NM, LOAD_FRICTION)),
    )


def _figure_1(cyclogram: str, effort: Effort, *, seed: int) -> FigureOne:
    values, classes, numbers = samples(fly_condition(cyclogram, TRAINING_NM), effort.every)
    stages: list[str] = []
    scheme = Scheme(networks=effort.networks)
    result = train_network(values, classes, numbers, seed=seed, scheme=scheme, tell=stages.append)
    tested, truth, _ = samples(fly_condition(cyclogram, TEST_NM))
    right = (result.network.p_emergency(tested) > 0.5) == truth
    return FigureOne(tuple(stages), result.network.keys, 100 * float(right.mean()))


def _leaks(training: dict[str, list[CyclogramSamples]]) -> tuple[CommandLeak, CommandLeak]:
    """Check the study's own data, and classes flown with different cyclograms, for a command leak."""
    other = next(name for name in training if name != MAIN)
    mixed = [training[MAIN][0], training[other][1]]
    found = []
    for flights in (training[MAIN], mixed):
        values, classes, numbers = samples(flights)
        with warnings.catch_warnings():
            # These data leak on purpose, and the report states it.
            warnings.simplefilter("ignore", CommandLeakWarning)
            found.append(check_command(values[:, 0], classes, numbers))
    return found[0], found[1]


def _moving() -> pd.DataFrame:
    rows = {
        name: {f"{flown.friction_nm:.3f}": flown.moving_fraction for flown in fly_condition(name, CONDITIONS)}
        for name in CYCLOGRAMS
    }
    table = pd.DataFrame(rows).T.rename_axis("cyclogram").reset_index()
    table["mean"] = table.drop(columns="cyclogram").mean(axis=1)
    return table


def first_table(findings: Findings, cyclogram: str) -> pd.DataFrame:
    """Return a row for each set of inputs on one cyclogram."""
    chosen = findings.groupings[cyclogram]
    names = {
        TWO: "two",
        chosen.pairwise_selected: "selected in pairs",
        SELECTED: "the paper's",
        chosen.selected: "selected by Algorithm 1",
        KEYS: "all",
    }
    rows = []
    for found in findings.experiments[cyclogram]:
        paper = BEST_12 if found.inputs == KEYS else BEST_SELECTED
        best = float(found.table["test"].max())
        rows.append(
            {
                "cyclogram": cyclogram,
                "inputs": f"{names[found.inputs]}: {_named(found.inputs)}",
                "paper, best of 50 by test, %": paper,
                f"ours, best of {len(found.table)} by test, %": best,
                "reaches the paper's": "yes" if best >= paper else "no",
                "ours, chosen without test data, %": found.without_test_data,
            }
        )
    return pd.DataFrame(rows)


def differences(findings: Findings) -> str:
    """Return what contradicts the paper, a sentence each, with its figures."""
    lines = []
    for name in (TAKEOFF, MAIN):
        by_inputs = {found.inputs: found for found in findings.experiments[name]}
        twelve, theirs, two = (by_inputs[inputs] for inputs in (KEYS, SELECTED, TWO))
        best = [float(found.table["test"].max()) for found in (twelve, theirs, two)]
        speed = theirs.seconds / twelve.seconds
        lines += [
            f'- "{name}": the paper\'s four inputs gain {best[1] - best[0]:+.2f} points on all twelve '
            f"(paper: {BEST_SELECTED - BEST_12:+.2f}).",
            f'- "{name}": learning with four inputs takes {speed:.2f} times as long as with twelve; '
            "the paper says that it is significantly faster.",
            f'- "{name}": {_named(TWO)} alone reach {best[2]:.2f} %; '
            "the paper says that the maximum needs all four.",
        ]
    if findings.bound:
        lines.append(f"- {_bound(findings.bound)}")
    return "What differs from the paper:\n\n" + "\n".join(lines)


def _bound(bound: Bound) -> str:
    # The share of the samples at rest that the paper's best needs, all others being right, %.
    needed = (BEST_SELECTED - 100 * bound.moving_share) / (1 - bound.moving_share)
    return (
        f"Why the paper's {BEST_SELECTED} % is hardly reached on the take-off: an oracle that learned "
        f"{bound.takeoffs} other take-offs at the test frictions themselves classifies "
        f"{100 * bound.all:.2f} % of the 60,000 test samples right, {100 * bound.moving:.2f} % of those in "
        f"motion and {100 * bound.standing:.2f} % of the {100 * (1 - bound.moving_share):.1f} % at rest. "
        f"{BEST_SELECTED} % needs {needed:.1f} % of those at rest from two training frictions alone."
    )


def _named(inputs: tuple[str, ...]) -> str:
    return ", ".join(inputs) if inputs != KEYS else "V1–V12"
