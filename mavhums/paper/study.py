"""Run of the whole study: compute it, then write the report, tables and figures."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole
from mavhums.core.quantities import KEYS, QUANTITIES
from mavhums.learn import (
    CommandLeak,
    CommandLeakWarning,
    Scheme,
    TrainingOptions,
    check_command,
    train_network,
)
from mavhums.paper.cyclograms import (
    CONDITIONS,
    CYCLOGRAMS,
    FIGURES_16_TO_19,
    PILOT,
    SELECTED,
    TAKEOFF,
    TEST_NM,
    TRAINING_NM,
    CyclogramSamples,
    fly_condition,
)
from mavhums.paper.experiment import (
    WEIGHT_DECAY,
    Effort,
    Experiment,
    emergency,
    run_experiment,
    samples,
)
from mavhums.paper.report import decay_table, report, statement_table
from mavhums.paper.tables import (
    LOAD_FRICTION,
    TWO,
    FigureOne,
    Findings,
    algorithm_1,
    chi_square_table,
    group_table,
    load_friction_table,
    p_level_table,
    subsets_of_four,
    table_1,
)

Progress = Callable[[int, int], None]

_DECAYS = {TAKEOFF: (0.0, 1e-6, WEIGHT_DECAY, 1e-2), PILOT: (0.0, WEIGHT_DECAY)}
_INPUTS = (KEYS, SELECTED, TWO)


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
    selections = {name: algorithm_1(flights) for name, flights in training.items()}
    plan = [
        (name, decay, inputs) for name, decays in _DECAYS.items() for decay in decays for inputs in _INPUTS
    ]
    plan += [(name, WEIGHT_DECAY, selection.selected) for name, selection in selections.items()]
    plan = list(dict.fromkeys(plan))
    steps = len(plan) + len(_DECAYS[TAKEOFF]) + len(_DECAYS) + 1
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, steps)

    run_experiment(TAKEOFF, KEYS, replace(Effort.quick(), networks=2, iterations=2), seed=seed)  # warms up
    found = {}
    for name, decay, inputs in plan:
        found[name, decay, inputs] = run_experiment(name, inputs, effort, seed=seed, weight_decay=decay)
        step()
    of_four = {}
    for decay in _DECAYS[TAKEOFF]:
        of_four[decay] = subsets_of_four(decay, effort, seed=seed)
        step()
    figure_1 = {}
    for name in _DECAYS:
        figure_1[name] = _figure_1(name, effort, seed=seed)
        step()
    loaded = load_friction_table(effort, seed=seed)
    step()
    return Findings(
        effort=effort,
        seed=seed,
        table_1=table_1(),
        chi_square=chi_square_table(training[TAKEOFF], fly_condition(TAKEOFF, CONDITIONS)),
        p_levels=p_level_table(),
        selections=selections,
        groups=group_table(),
        experiments={
            name: [one for key, one in found.items() if key[:2] == (name, WEIGHT_DECAY)]
            for name in CYCLOGRAMS
        },
        decays={
            (name, decay): [found[name, decay, inputs] for inputs in _INPUTS]
            for name, decays in _DECAYS.items()
            for decay in decays
        },
        subsets_of_four=of_four,
        figure_1=figure_1,
        moving_share=float(np.mean([flown.moving.mean() for flown in fly_condition(TAKEOFF, TEST_NM)])),
        leaks=_leaks(training),
        moving=_moving(),
        load_friction=loaded,
        load_selection=algorithm_1(fly_condition(TAKEOFF, TRAINING_NM, LOAD_FRICTION)),
    )


def _figure_1(cyclogram: str, effort: Effort, *, seed: int) -> FigureOne:
    values, classes, numbers = samples(fly_condition(cyclogram, TRAINING_NM), effort.every)
    stages: list[str] = []
    options = TrainingOptions(seed, scheme=Scheme(networks=effort.networks), report=stages.append)
    result = train_network(values, classes, numbers, options)
    tested, truth, _ = samples(fly_condition(cyclogram, TEST_NM))
    right = (result.network.p_emergency(tested) > 0.5) == truth
    return FigureOne(tuple(stages), result.network.keys, 100 * float(right.mean()))


def _leaks(training: dict[str, list[CyclogramSamples]]) -> tuple[CommandLeak, CommandLeak]:
    """Check the study's own data, and classes flown with different cyclograms, for a command leak."""
    mixed = [training[TAKEOFF][0], training[PILOT][1]]
    found = []
    for flights in (training[TAKEOFF], mixed):
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


def _quantities_figure(flown: CyclogramSamples) -> Figure:
    """Draw V1–V12 over the cyclogram (figures 3 to 14)."""
    figure = Figure(figsize=(13, 11), layout="constrained")
    for place, (axes, quantity) in enumerate(zip(figure.subplots(4, 3).flat, QUANTITIES, strict=True)):
        axes.plot(flown.time_s, flown.values[:, place], linewidth=0.7)
        axes.set_title(f"Figure {3 + place}: {quantity.key} {quantity.name}, {quantity.unit}", fontsize=9)
        axes.grid(alpha=0.3)
    figure.supxlabel("time, s")
    return figure


def _output_figure(experiment: Experiment, flights: Sequence[CyclogramSamples]) -> Figure:
    """Draw the network's output over the cyclogram at four frictions (figures 16 to 19)."""
    times = {flown.friction_nm: flown for flown in flights}
    figure = Figure(figsize=(13, 9), layout="constrained")
    for axes, (number, friction) in zip(figure.subplots(4, 1).flat, FIGURES_16_TO_19.items(), strict=True):
        flown = times[friction]
        axes.plot(flown.time_s, experiment.outputs[friction], linewidth=0.7, color="tab:red")
        wanted = "emergency" if emergency(flown) else "normal"
        axes.set_title(f"Figure {number}: T_c = {friction} N·m, {wanted}", fontsize=9)
        axes.set_ylim(-0.05, 1.05)
        axes.grid(alpha=0.3)
    figure.supylabel(f"probability of an emergency, inputs {', '.join(experiment.inputs)}")
    figure.supxlabel("time, s")
    return figure


def write_study(
    folder: str | os.PathLike[str],
    *,
    quick: bool = False,
    seed: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Compute the study and write ``report.md``, CSV tables and figures.

    Parameters
    ----------
    folder
        Output folder; created if it does not exist.
    quick
        Use fewer networks, iterations and samples: a preview, whose numbers should not be quoted.
    seed, progress
        See :func:`find`.

    Returns
    -------
    list of Path
        The written files; the report comes first.

    Raises
    ------
    MavhumsError
        If the folder cannot be written.
    MissingExtraError
        If torch or matplotlib is not installed.
    """
    out = Folder(Path(folder))
    begin = perf_counter()
    findings = find(Effort.quick() if quick else Effort(), seed=seed, progress=progress)
    text = report(findings, perf_counter() - begin)
    out.text("report.md", text)
    for name, table in _tables(findings).items():
        out.table(f"{name}.csv", table)
    flights = fly_condition(TAKEOFF, tuple(FIGURES_16_TO_19.values()))
    out.figure("figures-3-14.png", _quantities_figure(flights[0]))
    out.figure("figures-16-19.png", _output_figure(findings.takeoff[1], flights))
    return out.written


def _tables(findings: Findings) -> dict[str, pd.DataFrame]:
    def joined(name: str) -> pd.DataFrame:
        tables: dict[tuple[str, str], pd.DataFrame] = {
            (experiment.cyclogram, " ".join(experiment.inputs)): getattr(experiment, name)
            for part in findings.experiments.values()
            for experiment in part
        }
        return pd.concat(tables, names=["cyclogram", "inputs"]).reset_index(level=[0, 1])

    return {
        "table-1": findings.table_1,
        "figure-15-chi-square": findings.chi_square,
        "figure-15-groups": findings.groups,
        "weight-decay": decay_table(findings),
        "statements": statement_table(findings),
        "networks": joined("table"),
        "flights": joined("flights"),
        "moving-fraction": findings.moving,
        "load-friction": findings.load_friction,
    }


class Folder:
    """The folder of a report, and the list of files written into it.

    Parameters
    ----------
    path
        Created if it does not exist.

    Attributes
    ----------
    written
        Files in the order of their writing.

    Raises
    ------
    MavhumsError
        If the folder cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.written: list[Path] = []
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise MavhumsError(f"{path}: {error.strerror}", "name a folder that you may write to") from error

    def write(self, name: str, save: Callable[[Path], object]) -> Path:
        """Let ``save`` write a file beside its place, and move it there.

        Raises
        ------
        MavhumsError
            If the file cannot be written.
        """
        path = self.path / name
        with written_whole(path, remedy="name a folder that you may write to") as temporary:
            save(temporary)
        self.written.append(path)
        return path

    def text(self, name: str, text: str) -> Path:
        """Write text as UTF-8."""
        return self.write(name, lambda path: path.write_text(text, encoding="utf-8"))

    def table(self, name: str, table: pd.DataFrame) -> Path:
        """Write a table as CSV."""
        return self.write(name, lambda path: table.to_csv(path, index=False, float_format="%.6g"))

    def figure(self, name: str, figure: Figure) -> Path:
        """Write a figure as PNG."""
        return self.write(name, lambda path: figure.savefig(path, dpi=110, format="png"))
