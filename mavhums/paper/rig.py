"""Recordings of a real rig: runs of strokes in several conditions, and the features of each sequence.

A folder holds a table for each condition, ``NAME.csv.gz`` or ``NAME.csv``, with the columns of
:data:`COLUMNS`. That named ``normal`` is of the healthy rig; a number at the end of another name is the
stage of the fault.

References
----------
C. Ruiz-Carcel, A. Starr: Data set for "Data-based Detection and Diagnosis of Faults in Linear Actuators",
Cranfield University, doi 10.17862/cranfield.rd.5097649.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np
import pandas as pd

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.health.estimation.equations import STROKE_EQUATIONS
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.strokes import StrokeSums
from mavhums.results.verdict import OwnRecord

COLUMNS: Final = ("load", "run", "sequence", "time", "set_point", "position", "position_error", "current")
HEALTHY: Final = "normal"

Constants = Literal["as recorded", "run", "stroke"]
CONSTANTS: tuple[Constants, ...] = get_args(Constants)
"""What is taken off the current: nothing; the run's current at rest; its median in each stroke."""

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
