"""The results of the study: table 1, figure 15, groups of features, subset search, thinning; all together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import chi2

from mavhums.core.arrays import Array, Flags
from mavhums.core.quantities import KEYS, column
from mavhums.learn import (
    ChiSquareRanking,
    CommandLeak,
    Scheme,
    Selection,
    SubsetSearch,
    TanhNetworkEnsemble,
    VectorThinning,
    exhaustive_search,
    genetic_search,
    network_objective,
    select_features,
)
from mavhums.learn.evaluation import hold_out
from mavhums.learn.subsets import Objective
from mavhums.study.cyclograms import (
    CHI_SQUARE,
    MAIN,
    P_LEVELS,
    SELECTED,
    TABLE_1,
    TAKEOFF,
    TEST_NM,
    CyclogramSamples,
    fly_condition,
)
from mavhums.study.experiment import Bound, Effort, Experiment, emergency, run_experiment, samples
from mavhums_sim.ema import DataSheet, EmaParameters
from mavhums_sim.motion import CONTROL_PERIOD_S, simulate

_HEALTHY_NM = 0.225

TWO = ("V5", "V11")
"""The current and the load: what the torque balance needs besides the direction of motion."""


def table_1() -> pd.DataFrame:
    """Return the paper's characteristics, those of the simulated actuator, and how they were determined."""
    sheet, parameters = DataSheet(), EmaParameters.from_data_sheet(integral_gain=400.0)
    steps = round(2.0 / CONTROL_PERIOD_S)
    none, friction = np.zeros(steps), np.full(steps, _HEALTHY_NM)
    slew = simulate(parameters, np.full(steps, parameters.stroke), friction, none, none)
    ramp = np.radians(20.0) * np.arange(steps) * CONTROL_PERIOD_S
    lift = simulate(parameters, ramp, friction, none, np.full(steps, sheet.nominal_torque_nm))
    farthest = simulate(parameters, np.full(steps, np.radians(90.0)), friction, none, none)
    stall = parameters.torque_per_ampere * parameters.current_limit - _HEALTHY_NM
    ours = [
        (lift.load[-1], "load lifted at 20 °/s"),
        (stall, "torque at the current limit, less T_c"),
        (np.degrees(np.median(slew.speed[steps // 20 : steps // 5])), "simulated slew without load"),
        (np.degrees(farthest.angle[-1]), "simulated, commanded 90°"),
        (parameters.supply_voltage, "taken over"),
        (lift.current[-steps // 2 :].mean(), "simulated at the nominal torque, moving"),
        (sheet.mass_kg, "copied from the paper; not used"),
    ]
    return pd.DataFrame(
        {
            "characteristic": list(TABLE_1),
            "paper": list(TABLE_1.values()),
            "simulated": [float(value) for value, _ in ours],
            "how": [how for _, how in ours],
        }
    )


_PAIRS = 0.9
"""R² of the filter by pairs, whose polynomials explain less than Algorithm 1's regressions."""

_FEW = 5
"""With up to this many quantities, each subset's network is trained with full effort."""


class Grouping(NamedTuple):
    """Selected quantities and groups of interdependent ones, by Algorithm 1 and by the filter of pairs."""

    multiple: Selection
    pairs: Selection


def grouping(flights: list[CyclogramSamples]) -> Grouping:
    """Run Algorithm 1 and the pairwise filter on the flights' samples."""
    values, classes, _ = samples(flights)
    return Grouping(
        select_features(values, classes),
        select_features(values, classes, scheme=Scheme(select="pairwise", r2=_PAIRS)),
    )


def chi_square_table(training: list[CyclogramSamples], flights: list[CyclogramSamples]) -> pd.DataFrame:
    """Return each quantity's chi-square: the paper's, and ours by samples, bins and strategy."""
    table = pd.DataFrame({"quantity": list(CHI_SQUARE), "paper": list(CHI_SQUARE.values())})
    for name, part in (("training", training), ("all", flights)):
        values, classes, _ = samples(part)
        for bins in (10, 12):
            for strategy in ("width", "quantile"):
                ranking = ChiSquareRanking(bins=bins, strategy=strategy).fit(values, classes)
                table[f"{name} {bins} {strategy}"] = ranking.scores_
    return table.sort_values("paper", ascending=False, kind="stable", ignore_index=True)


def p_level_table() -> pd.DataFrame:
    """Return the p-levels of the paper's statistics by degrees of freedom, beside the published ones."""
    rows = [
        {"quantity": key, "chi-square": CHI_SQUARE[key], "paper": level}
        | {f"{dof} d.o.f.": float(chi2.sf(CHI_SQUARE[key], dof)) for dof in (1, 2, 3, 9, 11)}
        for key, level in P_LEVELS.items()
    ]
    return pd.DataFrame(rows)


def subset_table(
    training: list[CyclogramSamples],
    test: list[CyclogramSamples],
    keys: tuple[str, ...],
    effort: Effort,
    *,
    seed: int,
) -> tuple[pd.DataFrame, SubsetSearch, SubsetSearch | None]:
    """Score every subset of the quantities, and repeat the search genetically if they are many.

    Returns
    -------
    DataFrame
        A row for each subset, best first: validation accuracy (blocks of time held out of the
        training flights), and test accuracy of the same network size for comparison only.
    SubsetSearch, SubsetSearch or None
        Exhaustive search, and the genetic search on the same scores (None for few quantities).
    """
    columns = [column(key) for key in keys]
    random = np.random.default_rng(seed)
    values, classes, numbers = samples(training)
    few = len(keys) <= _FEW
    count = (5 if few else 1) * effort.subset_samples
    iterations = effort.iterations if few else effort.subset_iterations
    held_out, _ = hold_out(classes, numbers, random)
    parts = [
        (values[rows][:, columns], classes[rows])
        for rows in (
            random.permutation(np.flatnonzero(~held_out))[:count],
            random.permutation(np.flatnonzero(held_out))[: 2 * count],
        )
    ]
    tested = samples(test, every=60_000 // (2 * count))

    def objective(validation: tuple[Array, Flags]) -> Objective:
        return network_objective(parts[0], validation, max_iter=iterations, n_jobs=2, random_state=seed)

    search = exhaustive_search(objective(parts[1]), len(keys))
    on_test = objective((tested[0][:, columns], tested[1]))
    order = np.argsort(-search.scores, kind="stable")[:15]
    table = pd.DataFrame(
        {
            "subset": [" ".join(np.array(keys)[search.subsets[row]]) for row in order],
            "validation": 100 * search.scores[order],
            "test": 100 * on_test(search.subsets[order]),
        }
    )
    return table, search, None if few else _genetic(search)


def _genetic(search: SubsetSearch) -> SubsetSearch:
    known = {subset.tobytes(): score for subset, score in zip(search.subsets, search.scores, strict=True)}

    def look_up(subsets: Flags) -> Array:
        return np.array([known[subset.tobytes()] for subset in subsets])

    return genetic_search(look_up, search.subsets.shape[1], evaluations=len(known) // 10)


_Method = Literal["kmeans", "random"]
_METHODS: tuple[_Method, ...] = ("random", "kmeans")
_THINNINGS: tuple[tuple[str, _Method, bool], ...] = (
    ("random", "random", False),
    ("k-means", "kmeans", False),
    ("k-means, weighted", "kmeans", True),
)


def thinning_table(
    training: list[CyclogramSamples],
    test: list[CyclogramSamples],
    effort: Effort,
    *,
    seed: int,
) -> pd.DataFrame:
    """Return test accuracies of the paper's inputs with thinned precedents, by method and size.

    Each method is repeated with five seeds of ten networks; the medians over networks are
    averaged. Equal sizes compare k-means with and without weights against random thinning.
    """
    columns = [column(key) for key in SELECTED]
    values, classes, _ = samples(training)
    everything, truth, _ = samples(test, every=10)
    tested = everything[:, columns]
    rows = []
    for count in effort.thinning:
        medians: dict[str, list[float]] = {name: [] for name, _, _ in _THINNINGS}
        for repeat in range(seed, seed + 5):
            thinned = {
                method: VectorThinning(count, method=method, random_state=repeat).fit_resample(
                    values[:, columns], classes
                )
                for method in _METHODS
            }
            for name, method, weighted in _THINNINGS:
                features, labels, weights = thinned[method]
                ensemble = TanhNetworkEnsemble(
                    10,
                    max_iter=min(100, effort.iterations),
                    precision="single",
                    random_state=repeat,
                    n_jobs=2,
                ).fit(features, labels, weights if weighted else None)
                medians[name].append(100 * float(np.median(ensemble.member_scores(tested, truth))))
        rows += [
            {"vectors": count, "method": name, "test": np.mean(found), "sd of five": np.std(found, ddof=1)}
            for name, found in medians.items()
        ]
    return pd.DataFrame(rows)


LOAD_FRICTION = 0.3
"""μ of a real servo on a bench (docs/evidence/real-actuators.md); the paper's EMA has none."""

FEWER_NETWORKS = 10
"""Networks of each row of :func:`load_friction_table`."""


def load_friction_table(effort: Effort, *, seed: int) -> pd.DataFrame:
    """Return what networks are worth on an actuator whose friction grows with the load.

    Fewer networks than elsewhere, each trained at one μ and tested at both: the accuracy, %, of the network
    with the smallest training loss, and what it calls an emergency in normal flights at the larger μ.
    """
    fewer, rows = replace(effort, networks=min(effort.networks, FEWER_NETWORKS)), []
    for cyclogram in (TAKEOFF, MAIN):
        for inputs in (KEYS, SELECTED):
            for learned in (0.0, LOAD_FRICTION):
                network = run_experiment(cyclogram, inputs, fewer, seed=seed, load_friction=learned).network
                row: dict[str, object] = {
                    "cyclogram": cyclogram,
                    "inputs": " ".join(inputs) if inputs != KEYS else "12",
                    "trained at μ": f"{learned:g}",
                }
                for tested in (0.0, LOAD_FRICTION):
                    flights = fly_condition(cyclogram, TEST_NM, tested)
                    said = [
                        network.p_first(flown.values[:, [column(key) for key in inputs]]) > 0.5
                        for flown in flights
                    ]
                    right = [
                        (one == emergency(flown)).mean() for one, flown in zip(said, flights, strict=True)
                    ]
                    row[f"right at μ {tested:g}"] = 100 * float(np.mean(right))
                alarms = [one for one, flown in zip(said, flights, strict=True) if not emergency(flown)]
                rows.append(row | {f"normal called emergency at μ {tested:g}": 100 * float(np.mean(alarms))})
    return pd.DataFrame(rows)


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
        Leak of the command in the study's own data, and in classes flown with different cyclograms.
    load_friction, load_selection
        Networks on an actuator whose friction grows with the load, and the quantities selected for it.
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
    load_selection: Selection

    @property
    def main(self) -> list[Experiment]:
        """The experiments on the main cyclogram."""
        return self.experiments[MAIN]

    def experiment(self, cyclogram: str, inputs: tuple[str, ...]) -> Experiment:
        """Return the experiment on these inputs."""
        return next(each for each in self.experiments[cyclogram] if each.inputs == inputs)
