"""Run of the whole study: compute it, then write the report, tables, figures and recording."""

from __future__ import annotations

import os
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd

from mavhums.core.quantities import KEYS
from mavhums.study.cyclograms import MAIN, fly_condition
from mavhums.study.experiment import Effort
from mavhums.study.figures import FIGURES_16_TO_19, accuracy_figure, output_figure, quantities_figure
from mavhums.study.findings import Findings, Progress, find
from mavhums.study.outputs import Folder
from mavhums.study.recording import record_study
from mavhums.study.report import report

__all__ = ["write_study"]


def write_study(
    folder: str | os.PathLike[str],
    *,
    quick: bool = False,
    seed: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Compute the study and write ``report.md``, CSV tables, figures and ``study.rrd``.

    Parameters
    ----------
    folder
        Output folder; created if it does not exist.
    quick
        Use fewer networks, iterations and samples, and leave out the subset search and thinning: a
        preview, whose numbers should not be quoted.
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
        If torch, matplotlib or rerun is not installed.
    """
    out = Folder(Path(folder))
    begin = perf_counter()
    findings = find(Effort.quick() if quick else Effort(), seed=seed, progress=progress)
    text = report(findings, perf_counter() - begin)
    out.text("report.md", text)
    for name, table in _tables(findings).items():
        out.table(f"{name}.csv", table)
    flights = fly_condition(MAIN, tuple(FIGURES_16_TO_19.values()))
    out.figure("figures-3-14.png", quantities_figure(flights[0]))
    out.figure("figures-16-19.png", output_figure(findings.main[2], flights))
    everything = [experiment for part in findings.experiments.values() for experiment in part]
    out.figure("accuracy-against-moving-fraction.png", accuracy_figure(everything))
    out.write("study.rrd", lambda path: record_study(path, text, flights, findings.main))
    return out.written


def _tables(findings: Findings) -> dict[str, pd.DataFrame]:
    everything = [experiment for part in findings.experiments.values() for experiment in part]

    def joined(name: str) -> pd.DataFrame:
        parts = []
        for experiment in everything:
            part: pd.DataFrame = getattr(experiment, name).copy()
            part.insert(0, "inputs", " ".join(experiment.inputs))
            part.insert(0, "cyclogram", experiment.cyclogram)
            parts.append(part)
        return pd.concat(parts, ignore_index=True)

    networks = joined("table")
    networks["chosen"] = np.concatenate(
        [np.arange(len(experiment.table)) == experiment.chosen for experiment in everything]
    )
    left_out = {}
    if findings.subsets:
        _, search, _ = findings.subsets[KEYS]
        names = [" ".join(np.array(KEYS)[subset]) for subset in search.subsets]
        subsets = pd.DataFrame({"subset": names, "validation": 100 * search.scores})
        left_out = {
            "subsets-of-twelve": subsets.sort_values("validation", ascending=False, kind="stable"),
            "thinning": findings.thinning,
        }
    return left_out | {
        "table-1": findings.table_1,
        "figure-15-chi-square": findings.chi_square,
        "networks": networks,
        "flights": joined("flights"),
        "moving-fraction": findings.moving,
    }
