"""Training of many small networks, beside scikit-learn's; and the subset searches.

    python benchmarks/train.py [--quick] [--solver lbfgs] [--inputs 4] [--part subsets]

All on the paper's split: 20,000 training samples of the study's cyclogram, 60,000 test samples.
``--quick`` uses a tenth of the samples and networks and is not a benchmark.
"""

from __future__ import annotations

import argparse
import warnings
from time import perf_counter, process_time

import numpy as np
import pandas as pd
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier
from sklearn.preprocessing import MinMaxScaler

from mavhums.core.quantities import KEYS
from mavhums.learn import (
    NetworkOptions,
    TanhNetworkEnsemble,
    Vectors,
    exhaustive_search,
    genetic_search,
    network_objective,
)
from mavhums.paper.cyclograms import PILOT, SELECTED, TEST_NM, TRAINING_NM, fly_condition
from mavhums.paper.experiment import samples
from mavhums.paper.report import markdown_table

HIDDEN = tuple(range(4, 17))


def fifty(keys: tuple[str, ...], every: int, networks: int, solver: str) -> list[dict[str, object]]:
    """Train the same networks by torch and by scikit-learn, on the same rows."""
    columns = [KEYS.index(key) for key in keys]
    values, classes, _ = samples(fly_condition(PILOT, TRAINING_NM), every)
    tested, truth, _ = samples(fly_condition(PILOT, TEST_NM), every)
    values, tested = values[:, columns], tested[:, columns]
    begin = perf_counter()
    ensemble = TanhNetworkEnsemble(networks, HIDDEN, n_jobs=2, random_state=0).fit(values, classes)
    ours = perf_counter() - begin
    scaler = MinMaxScaler().fit(values)
    begin, reached = perf_counter(), []
    for seed in range(networks):
        network = MLPClassifier(
            (HIDDEN[seed % len(HIDDEN)],), activation="tanh", solver=solver, alpha=1e-4, random_state=seed
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            network.fit(scaler.transform(values), classes)
        reached.append(network.score(scaler.transform(tested), truth))
    theirs = perf_counter() - begin
    return [
        row(len(keys), "mavhums", ours, ours, ensemble.member_scores(tested, truth)),
        row(len(keys), f"scikit-learn, {solver}", theirs, ours, np.array(reached)),
    ]


def row(inputs: int, name: str, seconds: float, ours: float, scores: np.ndarray) -> dict[str, object]:
    return {
        "inputs": inputs,
        "training": name,
        "s": seconds,
        "times ours": seconds / ours,
        "test, median %": 100 * float(np.median(scores)),
        "test, best %": 100 * float(scores.max()),
    }


def subsets(count: int) -> None:
    """Train a network for each subset of the twelve quantities, then search the table genetically."""
    values, classes, _numbers = samples(fly_condition(PILOT, TRAINING_NM))
    # Every other ten seconds of each flight is held out.
    held_out = np.arange(len(values)) // 1000 % 2 == 1
    random = np.random.default_rng(0)
    training, validation = (
        random.permutation(np.flatnonzero(part))[:size]
        for part, size in ((~held_out, count), (held_out, 2 * count))
    )
    objective = network_objective(
        *(Vectors(values[rows], classes[rows]) for rows in (training, validation)),
        options=NetworkOptions(max_iter=60, n_jobs=2),
    )
    begin, spent = perf_counter(), process_time()
    search = exhaustive_search(objective, len(KEYS))
    seconds, processor = perf_counter() - begin, process_time() - spent
    best = ", ".join(np.array(KEYS)[search.best])
    print(
        f"\nall {len(search.scores)} subsets, {count} samples each: {seconds:.1f} s "
        f"({processor:.1f} s of processor time); best {100 * search.score:.2f} % ({best})"
    )
    table = {subset.tobytes(): score for subset, score in zip(search.subsets, search.scores, strict=True)}
    found = [
        genetic_search(
            lambda asked: np.array([table[subset.tobytes()] for subset in asked]),
            len(KEYS),
            evaluations=len(table) // 10,
            random_state=seed,
        )
        for seed in range(10)
    ]
    short = [100 * (search.score - each.score) for each in found]
    within = sum(points <= 0.1 + 1e-9 for points in short)
    most = max(len(each.scores) for each in found)
    print(
        f"genetic search on that table: within 0.1 points in {within} of 10 seeds, "
        f"worst {max(short):.2f} points, at most {most} evaluations ({100 * most / len(table):.1f} %)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--solver", default="adam", choices=["adam", "lbfgs"], help="of scikit-learn")
    parser.add_argument("--inputs", default=12, type=int, choices=[12, 4], help="V1–V12, or the paper's four")
    parser.add_argument("--part", default="all", choices=["all", "fifty", "subsets"], help="what to run")
    parser.add_argument("--quick", action="store_true", help="a tenth of the samples and networks")
    given = parser.parse_args()
    every, networks = (10, 5) if given.quick else (1, 50)
    keys = KEYS if given.inputs == 12 else SELECTED
    TanhNetworkEnsemble(2, max_iter=1).fit(np.eye(4), [0, 0, 1, 1])  # load what is loaded once

    if given.part != "subsets":
        print(markdown_table(pd.DataFrame(fifty(keys, every, networks, given.solver))), flush=True)
    if given.part != "fifty":
        subsets(100 if given.quick else 1000)


if __name__ == "__main__":
    main()
