"""The paper's method on recordings of a real rig: its selection and networks, split in five ways.

What a split leaves together decides the figure. Sequences of one run are alike, runs of one load share an
assembly and a load, and each condition was built once: only the splits that leave runs and loads out say what
is known of another day. The study also has trees, as published studies use them, and the indicators of
strokes, compared with the healthy runs alone.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import binomtest
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import StratifiedKFold

from mavhums.core.arrays import Flags
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations import STROKE_EQUATIONS
from mavhums.health.self_baseline.comparison import compare
from mavhums.learn import LabelledWindows, Scheme, TrainingOptions, train_windows
from mavhums.paper.report import render
from mavhums.paper.rig import CONSTANTS, FEATURES, HEALTHY, Constants, Run, examples, read_rig, stage
from mavhums.paper.study import Folder, Progress

MIXED, RUNS, LOADS, LATER, STAGES = (
    "sequences mixed",
    "whole runs kept together",
    "a load left out",
    "later runs left out",
    "early stages left out",
)
_EARLIER: Final = 0.6
"""Share of a condition's runs at one load, in their order, that the split by order trains on."""


@dataclass(frozen=True)
class Size:
    """Size of the computations: folds, networks to choose from (a fifth is trained), trees, and constants."""

    folds: int = 3
    networks: int = 50
    trees: int = 500
    constants: tuple[Constants, ...] = CONSTANTS

    @classmethod
    def quick(cls) -> Size:
        """Return a size for a preview."""
        return cls(folds=2, networks=10, trees=100, constants=("run",))


def rate(found: int, of: int) -> str:
    """Return a rate with its 95 % interval after Wilson.

    Examples
    --------
    >>> rate(0, 21), rate(27, 30)
    ('0/21 (0–15 %)', '27/30 (74–97 %)')
    """
    if of == 0:
        return "–"
    interval = binomtest(found, of).proportion_ci(method="wilson")
    return f"{found}/{of} ({100 * interval.low:.0f}–{100 * interval.high:.0f} %)"


def splits(table: pd.DataFrame, folds: int, seed: int) -> Iterator[tuple[str, Flags, Flags]]:
    """Yield name, and the masks of the sequences to train on and to test, of each fold of each split."""
    count = len(table)
    # Runs of a condition and load in their order, from 0.
    order = table.groupby(["condition", "load"])["run"].rank(method="dense").to_numpy() - 1
    runs = table.groupby(["condition", "load"])["run"].transform("nunique").to_numpy()
    stratified = StratifiedKFold(folds, shuffle=True, random_state=seed)
    for train, test in stratified.split(np.zeros(count), table["condition"]):
        yield MIXED, np.isin(np.arange(count), train), np.isin(np.arange(count), test)
    for fold in range(folds):
        yield RUNS, order % folds != fold, order % folds == fold
    for load in np.unique(table["load"]) if table["load"].nunique() > 1 else ():
        yield LOADS, (table["load"] != load).to_numpy(), (table["load"] == load).to_numpy()
    later = order >= np.ceil(_EARLIER * runs)
    if later.any():
        yield LATER, ~later, later
    early = table["condition"].isin(_early(sorted(set(table["condition"])))).to_numpy()
    if early.any():
        healthy = (table["condition"] == HEALTHY).to_numpy() & (order % 2 == 1)
        yield STAGES, ~early & ~healthy, early | healthy


def _early(conditions: Sequence[str]) -> list[str]:
    """Return the lower half of the stages of each kind of fault that has several.

    Examples
    --------
    >>> _early(["normal", "play2", "spalling1", "spalling3", "spalling5", "spalling8"])
    ['spalling1', 'spalling3']
    """
    kinds: dict[str, list[tuple[int, str]]] = {}
    for condition in conditions:
        kind, number = stage(condition)
        if number is not None:
            kinds.setdefault(kind, []).append((number, condition))
    return [name for stages in kinds.values() for _, name in sorted(stages)[: len(stages) // 2]]


def _answers(
    table: pd.DataFrame, runs: Sequence[Run], size: Size, seed: int, progress: Progress | None
) -> tuple[pd.DataFrame, list[str]]:
    """Return what networks and trees call each tested sequence, and a line for each stage of one selection.

    A row has the ``place`` of the sequence's run, its condition (``truth``) and what the ``method`` of the
    ``split`` called it (``called``), with the ``constants`` taken off the current.
    """
    names, classes = np.unique(table["condition"].to_numpy(dtype=str), return_inverse=True)
    folds = list(splits(table, size.folds, seed))
    found: list[pd.DataFrame] = []
    lines: list[str] = []
    for k, constants in enumerate(size.constants):
        features = examples(runs, constants)[1]
        for done, (split, train, test) in enumerate(folds, 1):
            # Whole runs are held out for the stages' own choices, too, but where the split mixes them.
            groups = np.arange(len(table)) if split == MIXED else table["place"].to_numpy()
            part = LabelledWindows(features[train], classes[train], groups[train])
            options = TrainingOptions(seed, FEATURES, Scheme(networks=size.networks, vectors=None))
            if split == LOADS and constants == "run" and not lines:
                options = replace(options, report=lines.append)
            trained = train_windows(part, len(names), options, columns=FEATURES)
            inputs = features[test][:, [FEATURES.index(name) for name in trained.inputs]]
            trees = ExtraTreesClassifier(size.trees, random_state=seed).fit(part.features, part.classes)
            tested = table.loc[test, ["place", "condition"]].rename(columns={"condition": "truth"})
            tested = tested.assign(split=split, constants=constants)
            for method, called in (
                ("networks", trained.network.outputs(inputs).argmax(axis=1)),
                ("trees", trees.predict(features[test])),
            ):
                found.append(tested.assign(method=method, called=names[called]))
            if progress:
                progress(k * len(folds) + done, len(size.constants) * len(folds))
    return pd.concat(found), lines


def accuracies(answers: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each split, what was taken off the current, and method.

    Where early stages are left out, a sequence is right if its kind of fault is named.
    """
    rows = []
    for (split, constants, method), part in answers.groupby(["split", "constants", "method"], sort=False):
        truth, called = part["truth"], part["called"]
        healthy, said = truth == HEALTHY, called == HEALTHY
        if split == STAGES:
            truth, called = (names.map(lambda name: stage(name)[0]) for names in (truth, called))
        right = called == truth
        runs = right.groupby(part["place"]).mean() > 0.5
        rows.append(
            {
                "split": split,
                "taken off the current": "nothing"
                if constants == "as recorded"
                else f"level of the {constants}",
                "method": method,
                "sequences right, %": 100 * float(right.mean()),
                "runs right": rate(int(runs.sum()), len(runs)),
                "healthy called faulty, %": 100 * float((~said)[healthy].mean()),
                "faulty called healthy, %": 100 * float(said[~healthy].mean()),
            }
        )
    return pd.DataFrame(rows)


def confusion(answers: pd.DataFrame, split: str) -> pd.DataFrame:
    """Return the shares, %, in which the networks called each condition, without the constant of a run."""
    of_networks = (answers["constants"] == "run") & (answers["method"] == "networks")
    part = answers[of_networks & (answers["split"] == split)]
    shares = 100 * pd.crosstab(part["truth"], part["called"], normalize="index")
    names = sorted({*answers["truth"], *answers["called"]})
    found = shares.reindex(columns=names, fill_value=0).round(0).astype(int)
    return found.rename_axis(index="condition", columns=None).reset_index()


def strokes_table(runs: Sequence[Run]) -> pd.DataFrame:
    """Return for each condition and load how many runs each indicator of strokes found.

    Each run is compared with the healthy runs, a healthy one without itself; no fault is learned.
    """
    records = [run.records() for run in runs]
    healthy = [k for k, run in enumerate(runs) if run.condition == HEALTHY]
    rows = []
    for k, (run, own) in enumerate(zip(runs, records, strict=True)):
        others = [records[j] for j in healthy if j != k]
        past = [PastRecord(one, f"2000-01-{n:02d}", healthy=True) for n, one in enumerate(others, 1)]
        said = {
            equation.quantity: compare(equation, record, past).condition
            for equation in STROKE_EQUATIONS
            for record in own
            if record.equation == equation.name
        }
        rows.append({"condition": run.condition, "load": run.load, **said})
    table, quantities = pd.DataFrame(rows), [equation.quantity for equation in STROKE_EQUATIONS]
    found = []
    for (condition, load), part in table.groupby(["condition", "load"]):
        row = {"condition": condition, "load": load}
        changed = part.reindex(columns=quantities) == "changed"
        row |= {name: rate(int(changed[name].sum()), len(part)) for name in quantities}
        found.append(row | {"any": rate(int(changed.any(axis=1).sum()), len(part))})
    return pd.DataFrame(found)


def write_real_study(
    data: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    quick: bool = False,
    seed: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Compute the study of a rig's recordings, and write ``report.md`` and CSV tables.

    Parameters
    ----------
    data
        Folder of the recordings; or one with a ``cranfield`` in it.
    folder
        Output folder; created if it does not exist.
    quick
        Fewer folds, networks and trees, and the run's constant taken off only: a preview.
    seed
        Of folds, networks and trees.
    progress
        Called with the steps done and of all.

    Returns
    -------
    list of Path
        The written files; the report comes first.

    Raises
    ------
    MavhumsError
        If the recordings cannot be read, or the folder cannot be written.
    MissingExtraError
        If torch or pygad is not installed.
    """
    runs, repeated = read_rig(Path(data))
    out, size = Folder(Path(folder)), Size.quick() if quick else Size()
    table = examples(runs, "as recorded")[0]
    answers, stages = _answers(table, runs, size, seed, progress)
    found, strokes = accuracies(answers), strokes_table(runs)
    confusions = {split: confusion(answers, split) for split in (RUNS, LOADS, LATER, STAGES)}
    counts = table.groupby("condition").agg(runs=("place", "nunique"), sequences=("place", "size"))
    text = render(
        "rig.md.jinja",
        table=table,
        counts=counts.reset_index(),
        repeated=repeated,
        quick=quick,
        accuracies=found,
        confusions=confusions,
        strokes=strokes,
        stages=stages,
    )
    out.text("report.md", text)
    out.table("accuracies.csv", found)
    out.table("strokes.csv", strokes)
    for split, one in confusions.items():
        if len(one):
            out.table(f"confusion-{split.replace(' ', '-')}.csv", one)
    return out.written
