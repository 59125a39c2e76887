"""The paper's method on recordings of a real rig: its selection and networks, split in five ways.

A folder holds a table for each condition, ``NAME.csv.gz`` or ``NAME.csv``, with the columns of
:data:`COLUMNS`. That named ``normal`` is of the healthy rig; a number at the end of another name is the
stage of the fault.

What a split leaves together decides the figure. Sequences of one run are alike, runs of one load share an
assembly and a load, and each condition was built once: only the splits that leave runs and loads out say what
is known of another day. Beside the networks stand trees, as published studies use them, and the indicators of
strokes, compared with the healthy runs alone.

References
----------
C. Ruiz-Carcel, A. Starr: Data set for "Data-based Detection and Diagnosis of Faults in Linear Actuators",
Cranfield University, doi 10.17862/cranfield.rd.5097649.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np
import pandas as pd
from scipy.stats import binomtest
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import confusion_matrix
from sklearn.model_selection import StratifiedKFold

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations import STROKE_EQUATIONS
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.strokes import StrokeSums
from mavhums.health.self_baseline.comparison import compare
from mavhums.learn import LabelledWindows, Scheme, TanhNetwork, TrainingOptions, TrainingResult, train_windows
from mavhums.paper.report import render
from mavhums.paper.study import Folder, Progress
from mavhums.results.verdict import OwnRecord

COLUMNS: Final = ("load", "run", "sequence", "time", "set_point", "position", "position_error", "current")
HEALTHY: Final = "normal"

Constants = Literal["as recorded", "run", "stroke"]
CONSTANTS: tuple[Constants, ...] = get_args(Constants)
"""What is taken off the current: nothing; the run's standing current; its median in each stroke."""

_STATISTICS: Final = ("mean", "sd")
_PARTS: Final = tuple(f"{part} {half}" for part, half in product(("out", "rest", "back"), (1, 2)))
_MOVING_SHARE: Final = 0.2
"""Share of the largest commanded speed from which the rig moves."""
_LEAST_SAMPLES: Final = 8
"""Samples of each part of the motion; fewer give no standard deviation."""


@dataclass(frozen=True, eq=False)
class Run:
    """One test at one load: several sequences of out, rest and back.

    Attributes
    ----------
    condition, load, number
        Name of the condition, the load as labelled, and the test's number.
    rows
        Its samples in order, with the columns of :data:`COLUMNS`.
    """

    condition: str
    load: float
    number: int
    rows: pd.DataFrame

    def flown(self) -> tuple[Array, Array]:
        """Return times, s, and V1…V12 as of a flight, shapes (n,) and (n, 12): 1 mm as 1°."""
        rows = self.rows
        length = rows.groupby("sequence")["time"].max().max() + rows["time"].diff().abs().median()
        begin = rows["sequence"].rank(method="dense").to_numpy() - 1
        values = np.full((len(rows), len(KEYS)), np.nan)
        for key, name in (("V1", "set_point"), ("V3", "position"), ("V5", "current")):
            values[:, column(key)] = rows[name]
        return np.asarray(begin * length + rows["time"], dtype=np.float64), values

    def records(self) -> tuple[OwnRecord, ...]:
        """Return the run's records of its strokes, as those of a flight."""
        time_s, values = self.flown()
        actuator = Actuator(name="rig", servo=1, pwm_us=(1000, 1500, 2000))
        cutter, sums = SlotCutter(), [StrokeSums(equation, actuator) for equation in STROKE_EQUATIONS]
        for slots in (cutter.feed(time_s, with_extra_columns(values)), cutter.finish()):
            for one in sums:
                if slots is not None:
                    one.feed(slots)
        return tuple(record for one in sums if (record := one.record()))


def read_rig(folder: Path) -> tuple[list[Run], list[str]]:
    """Return the runs of a folder, or of its ``cranfield``, without those that repeat another, and these.

    Raises
    ------
    MavhumsError
        If there is no table of the healthy rig and of another condition, or one lacks a column.
    """
    inner = folder / "cranfield"
    tables = sorted((inner if inner.is_dir() else folder).glob("*.csv*"))
    runs: list[Run] = []
    repeated: list[str] = []
    for path in tables:
        name, seen = path.name.split(".csv")[0], set()
        for (load, number), rows in _table(path).groupby(["load", "run"]):
            what = rows[["position", "current"]].to_numpy().tobytes()
            if what in seen:
                repeated.append(f"{name}, load {load}, run {number}")
                continue
            seen.add(what)
            runs.append(Run(name, float(rows["load"].iloc[0]), int(rows["run"].iloc[0]), rows))
    conditions = {run.condition for run in runs}
    if HEALTHY not in conditions or len(conditions) < 2:
        problem = f"{folder}: no table of the healthy rig ({HEALTHY}.csv.gz) and of another condition"
        raise MavhumsError(problem, "name the folder that contains a table for each condition")
    return runs, repeated


def _table(path: Path) -> pd.DataFrame:
    remedy = f"write a table with the columns {', '.join(COLUMNS)}"
    try:
        table = pd.read_csv(path)
    except (OSError, EOFError, ValueError) as error:
        raise MavhumsError(f"{path}: {error}", remedy) from error
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise MavhumsError(f"{path}: no column {missing[0]}", remedy)
    wrong = [name for name in COLUMNS if not np.isfinite(pd.to_numeric(table[name], "coerce")).all()]
    if wrong:
        raise MavhumsError(f"{path}: column {wrong[0]} has a cell that is no number", remedy)
    return table


def stage(condition: str) -> tuple[str, int | None]:
    """Return the kind of a fault, and its stage; None without one.

    Examples
    --------
    >>> stage("spalling8"), stage("normal")
    (('spalling', 8), ('normal', None))
    """
    found = re.fullmatch(r"(.*?)(\d+)", condition)
    return (found[1], int(found[2])) if found and found[1] else (condition, None)


def _names() -> Iterator[str]:
    for quantity in ("current", "error"):
        yield from (f"{quantity} {what}, {part}" for part in _PARTS for what in _STATISTICS)
        yield from (f"{quantity} from {a} to {b}" for a, b in pairwise(_PARTS))
        yield f"{quantity} from out to back"


FEATURES: Final = tuple(_names())
"""Of a sequence: mean and standard deviation of current and position error in six parts of its motion, and
differences between the means."""


def examples(runs: Sequence[Run], constants: Constants) -> tuple[pd.DataFrame, Array]:
    """Return a row for each sequence, with its run's place in ``runs``, and its features (n, 36).

    Sequences without a motion out, a rest and a motion back are left out.
    """
    rows, found = [], []
    for place, run in enumerate(runs):
        parts = [(part, one) for _, one in run.rows.groupby("sequence") if (part := _parts(one)) is not None]
        if not parts:
            continue
        currents = [one["current"].to_numpy(dtype=np.float64) for _, one in parts]
        level = _levels([part for part, _ in parts], currents, constants)
        for (part, one), current in zip(parts, currents, strict=True):
            known = part >= 0
            error = one["position_error"].to_numpy(dtype=np.float64)
            less = current[known] - level[part[known]]
            found.append([*_described(part[known], less), *_described(part[known], error[known])])
            rows.append((place, run.condition, run.load, run.number))
    if not found:
        raise MavhumsError(
            "no sequence has a motion out, a rest and a motion back",
            "name recordings of strokes at constant speed, with the rest between them",
        )
    return pd.DataFrame(rows, columns=["place", "condition", "load", "run"]), np.array(found)


def _parts(sequence: pd.DataFrame) -> Integers | None:
    """Return the part of each sample, -1 where it is in none; None if the motion lacks one."""
    time_s, point = (sequence[name].to_numpy(dtype=np.float64) for name in ("time", "set_point"))
    if time_s.size < 3 or (np.diff(time_s) <= 0).any():
        return None
    rate = np.gradient(point, time_s)
    way = np.where(np.abs(rate) > _MOVING_SHARE * np.abs(rate).max(), np.sign(rate), 0.0)
    edges = [0, *(np.flatnonzero(np.diff(way)) + 1).tolist(), way.size]
    spans = [(a, b) for a, b in pairwise(edges) if b - a >= 2 * _LEAST_SAMPLES]
    ways = [way[a] for a, _ in spans]
    out = next((k for k, one in enumerate(ways) if one), None)
    if out is None or ways[out + 1 : out + 3] != [0.0, -ways[out]]:
        return None
    part = np.full(way.size, -1)
    for k, (a, b) in enumerate(spans[out : out + 3]):
        half = (a + b) // 2
        part[a:half], part[half:b] = 2 * k, 2 * k + 1
    return part


def _levels(parts: Sequence[Integers], currents: Sequence[Array], constants: Constants) -> Array:
    """Return what is taken off the current in each of the six parts."""
    part, current = np.concatenate(parts), np.concatenate(currents)
    rest = (part == 2) | (part == 3)
    if constants == "as recorded":
        return np.zeros(len(_PARTS))
    if constants == "run":
        return np.full(len(_PARTS), np.median(current[rest]))
    return np.repeat([float(np.median(current[part // 2 == k])) for k in range(3)], 2)


def _described(part: Integers, values: Array) -> list[float]:
    means = [float(values[part == k].mean()) for k in range(len(_PARTS))]
    deviations = [float(values[part == k].std()) for k in range(len(_PARTS))]
    apart = [b - a for a, b in pairwise(means)]
    out_back = means[4] + means[5] - means[0] - means[1]
    return [*(one for pair in zip(means, deviations, strict=True) for one in pair), *apart, out_back / 2]


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


@dataclass(frozen=True, eq=False)
class SplitResult:
    """What one method said of the sequences that a split tests.

    Attributes
    ----------
    split, constants, method
        How it was trained.
    rows
        Places of the tested sequences in the table, shape (n,).
    told
        Index of the condition that it named, shape (n,).
    """

    split: str
    constants: Constants
    method: str
    rows: Integers
    told: Integers


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
) -> tuple[list[SplitResult], tuple[str, ...]]:
    """Return the answers of networks and trees, and a line for each stage of one selection."""
    names = sorted(set(table["condition"]))
    classes = np.array([names.index(condition) for condition in table["condition"]])
    folds = list(splits(table, size.folds, seed))
    found: list[SplitResult] = []
    lines: list[str] = []
    for k, constants in enumerate(size.constants):
        features = examples(runs, constants)[1]
        for done, (split, train, test) in enumerate(folds):
            # Whole runs are held out for the stages' own choices, too, but where the split mixes them.
            groups = np.arange(len(table)) if split == MIXED else table["place"].to_numpy()
            part = LabelledWindows(features[train], classes[train], groups[train])
            options = TrainingOptions(seed, FEATURES, Scheme(networks=size.networks, vectors=None))
            if split == LOADS and constants == "run" and not lines:
                options = replace(options, tell=lines.append)
            network = train_windows(part, len(names), options, columns=FEATURES)
            trees = ExtraTreesClassifier(size.trees, random_state=seed).fit(part.features, part.classes)
            rows = np.flatnonzero(test)
            for method, told in (
                ("networks", _classes_of(network, features[test])),
                ("trees", trees.predict(features[test])),
            ):
                found.append(SplitResult(split, constants, method, rows, told))
            if progress:
                progress(k * len(folds) + done + 1, len(size.constants) * len(folds))
    return found, tuple(lines)


def _classes_of(network: TrainingResult[TanhNetwork], features: Array) -> Integers:
    columns = [FEATURES.index(name) for name in network.inputs]
    told: Integers = network.network.outputs(features[:, columns]).argmax(axis=1)
    return told


def accuracies(table: pd.DataFrame, answers: Sequence[SplitResult]) -> pd.DataFrame:
    """Return a row for each split, what was taken off the current, and method.

    Where early stages are left out, a sequence is right if its kind of fault is named.
    """
    names = sorted(set(table["condition"]))
    kinds = np.array([stage(name)[0] for name in names])
    rows = []
    for (split, constants, method), parts in _by(answers):
        place, told = (np.concatenate([getattr(part, what) for part in parts]) for what in ("rows", "told"))
        tested = table.iloc[place]
        truth = np.array([names.index(condition) for condition in tested["condition"]])
        right = kinds[told] == kinds[truth] if split == STAGES else told == truth
        runs = pd.Series(right).groupby(tested["place"].to_numpy()).mean() > 0.5
        healthy, said = truth == names.index(HEALTHY), told == names.index(HEALTHY)
        rows.append(
            {
                "split": split,
                "taken off the current": "nothing"
                if constants == "as recorded"
                else f"level of the {constants}",
                "method": method,
                "sequences right, %": 100 * float(right.mean()),
                "runs right": rate(int(runs.sum()), len(runs)),
                "healthy called faulty, %": 100 * float((~said)[healthy].mean()) if healthy.any() else np.nan,
                "faulty called healthy, %": 100 * float(said[~healthy].mean()),
            }
        )
    return pd.DataFrame(rows)


def _by(answers: Sequence[SplitResult]) -> Iterator[tuple[tuple[str, Constants, str], list[SplitResult]]]:
    keys = dict.fromkeys((one.split, one.constants, one.method) for one in answers)
    for key in keys:
        yield key, [one for one in answers if (one.split, one.constants, one.method) == key]


def confusion(table: pd.DataFrame, answers: Sequence[SplitResult], split: str) -> pd.DataFrame:
    """Return the shares, %, in which the networks called each condition, without the constant of a run."""
    names = sorted(set(table["condition"]))
    parts = [a for a in answers if (a.split, a.constants, a.method) == (split, "run", "networks")]
    if not parts:
        return pd.DataFrame()
    truth = np.concatenate([[names.index(c) for c in table.iloc[part.rows]["condition"]] for part in parts])
    told = np.concatenate([part.told for part in parts])
    shares = 100 * confusion_matrix(truth, told, labels=np.arange(len(names)), normalize="true")
    found = pd.DataFrame(shares, columns=names).round(0).astype(int)
    found.insert(0, "condition", names)
    return found[np.isin(np.arange(len(names)), truth)]


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
    found, strokes = accuracies(table, answers), strokes_table(runs)
    confusions = {split: confusion(table, answers, split) for split in (RUNS, LOADS, LATER, STAGES)}
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
