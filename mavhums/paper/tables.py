"""Tables of the study: table 1, figure 15, groups of features; all results together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd
from scipy.stats import chi2

from mavhums.core.quantities import KEYS, column
from mavhums.learn import (
    ChiSquareRanking,
    CommandLeak,
    NetworkOptions,
    Scheme,
    Selection,
    Vectors,
    network_objective,
    select_features,
)
from mavhums.paper.cyclograms import (
    CHI_SQUARE,
    P_LEVELS,
    PILOT,
    SELECTED,
    TABLE_1,
    TAKEOFF,
    TEST_NM,
    TRAINING_NM,
    CyclogramSamples,
    fly_condition,
)
from mavhums.paper.experiment import Effort, Experiment, run_experiment, samples
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


_SETTINGS = [Scheme(order=order, r2=r2) for order in (1, 2) for r2 in (0.9, 0.99, 0.999, 0.9999)]
_SETTINGS += [Scheme(select="pairwise", r2=r2) for r2 in (0.9, 0.99, 0.999)]
"""Of Algorithm 1, and of polynomials of one other quantity alone."""


def algorithm_1(flights: list[CyclogramSamples], scheme: Scheme | None = None) -> Selection:
    """Run a filter of features on the flights' samples, by default Algorithm 1 as ``mavhums train``."""
    values, classes, _ = samples(flights)
    return select_features(values, classes, scheme=scheme or Scheme())


def group_table() -> pd.DataFrame:
    """Return groups of interdependent quantities by cyclogram and setting of the filter."""
    rows = []
    for cyclogram, scheme in product((TAKEOFF, PILOT), _SETTINGS):
        found = algorithm_1(fly_condition(cyclogram, TRAINING_NM), scheme)
        rows.append(
            {
                "cyclogram": cyclogram,
                "filter": "pairs" if scheme.select == "pairwise" else f"Algorithm 1, m = {scheme.order}",
                "R²": f"{scheme.r2:g}",
                "groups": " ".join("{" + ", ".join(group) + "}" for group in found.groups),
                "number": len(found.groups),
                "selected": ", ".join(found.selected),
            }
        )
    return pd.DataFrame(rows)


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


def subsets_of_four(weight_decay: float, effort: Effort, *, seed: int) -> dict[tuple[str, ...], float]:
    """Return the test accuracy, %, of each subset of the paper's four inputs on the take-off.

    Each is the best of five networks of eight neurons, by test accuracy as in the paper; they learn every
    fourth sample.
    """
    training, test = (fly_condition(TAKEOFF, several) for several in (TRAINING_NM, TEST_NM))
    columns = [column(key) for key in SELECTED]
    parts = [
        Vectors(values[:, columns], classes)
        for values, classes, _ in (samples(training, 4 * effort.every), samples(test, 10))
    ]
    subsets = np.array(list(product((False, True), repeat=len(SELECTED))))[1:]
    options = NetworkOptions(weight_decay, effort.iterations, n_jobs=2)
    scores = [
        network_objective(*parts, random_state=seed + k, options=options)(subsets)
        for k in range(min(5, effort.networks))
    ]
    names = [tuple(np.array(SELECTED)[subset].tolist()) for subset in subsets]
    return dict(zip(names, (100 * np.max(scores, axis=0)).tolist(), strict=True))


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
    for cyclogram in (TAKEOFF, PILOT):
        for inputs in (KEYS, SELECTED):
            for learned in (0.0, LOAD_FRICTION):
                network = run_experiment(cyclogram, inputs, fewer, seed=seed, load_friction=learned).network
                row: dict[str, object] = {
                    "cyclogram": cyclogram,
                    "inputs": " ".join(inputs) if inputs != KEYS else "12",
                    "trained at μ": f"{learned:g}",
                }
                for tested in (0.0, LOAD_FRICTION):
                    values, worn, _ = samples(fly_condition(cyclogram, TEST_NM, tested))
                    said = network.p_first(values[:, [column(key) for key in inputs]]) > 0.5
                    row[f"right at μ {tested:g}"] = 100 * float(np.mean(said == worn))
                alarms = 100 * float(np.mean(said[~worn]))
                rows.append(row | {f"normal called emergency at μ {tested:g}": alarms})
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
    selections, groups
        What Algorithm 1 selects, by cyclogram, and :func:`group_table`.
    experiments
        Experiments, by cyclogram.
    decays
        Experiments on all inputs, the paper's and two, by cyclogram and weight decay.
    subsets_of_four
        :func:`subsets_of_four` by weight decay.
    moving_share
        Share of the test samples of the take-off in which the actuator moves.
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
    selections: dict[str, Selection]
    groups: pd.DataFrame
    experiments: dict[str, list[Experiment]]
    decays: Mapping[tuple[str, float], list[Experiment]]
    subsets_of_four: dict[float, dict[tuple[str, ...], float]]
    figure_1: dict[str, FigureOne]
    moving_share: float
    leaks: tuple[CommandLeak, CommandLeak]
    moving: pd.DataFrame
    load_friction: pd.DataFrame
    load_selection: Selection

    @property
    def takeoff(self) -> list[Experiment]:
        """The experiments on the take-off: of all inputs, the paper's, two, and Algorithm 1's."""
        return self.experiments[TAKEOFF]
