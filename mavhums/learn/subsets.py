"""Wrapper methods: exhaustive and genetic search of the subset with the best network (paper, section 2)."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.errors import MissingExtraError
from mavhums.learn._estimators import train_networks

if TYPE_CHECKING:
    from mavhums.learn.batched import Samples

Objective = Callable[[Flags], Array]
"""Function of non-empty subsets, shape (s, k), that returns their scores, shape (s,)."""


@dataclass(frozen=True, eq=False)
class SubsetSearch:
    """Result of a subset search.

    Attributes
    ----------
    subsets
        The scored subsets, shape (s, k), without duplicates.
    scores
        Score of each subset, shape (s,).
    """

    subsets: Flags
    scores: Array

    @property
    def best(self) -> Flags:
        """The subset with the largest score; ties go to the one with the fewest features."""
        ties = np.flatnonzero(self.scores == self.scores.max())
        chosen: Flags = self.subsets[ties[np.argmin(self.subsets[ties].sum(axis=1))]]
        return chosen

    @property
    def score(self) -> float:
        """The largest score."""
        return float(self.scores.max())


def all_subsets(features: int) -> Flags:
    """Return the 2^k - 1 non-empty subsets of k features, shape (2^k - 1, k).

    Examples
    --------
    >>> all_subsets(2).astype(int).tolist(), len(all_subsets(4)), len(all_subsets(12))
    ([[1, 0], [0, 1], [1, 1]], 15, 4095)
    """
    codes = np.arange(1, 2**features)
    return (codes[:, None] >> np.arange(features) & 1).astype(bool)


def exhaustive_search(objective: Objective, features: int) -> SubsetSearch:
    """Score every subset of the features, which finds the global optimum (paper, section 2)."""
    subsets = all_subsets(features)
    return SubsetSearch(subsets, objective(subsets))


def genetic_search(
    objective: Objective,
    features: int,
    *,
    evaluations: int = 400,
    population: int = 40,
    random_state: int = 0,
) -> SubsetSearch:
    """Search by a genetic algorithm, when there are too many subsets to score all (paper, section 2).

    One call of the objective scores a whole generation, and no subset is scored twice.

    Parameters
    ----------
    objective
        The same as for :func:`exhaustive_search`.
    features
        k.
    evaluations
        Maximum number of different subsets to score.
    population
        Number of subsets in a generation.
    random_state
        Seed; the global generators of numpy and Python are unchanged afterwards.

    Raises
    ------
    MissingExtraError
        If pygad is not installed.
    """
    try:
        import pygad
    except ModuleNotFoundError as error:
        raise MissingExtraError("genetic search", "train") from error
    scored: dict[bytes, tuple[Flags, float]] = {}

    def fitness(_: Any, solutions: Any, __: Any) -> list[float]:
        genes = np.atleast_2d(np.asarray(solutions)).astype(bool)
        new = {row.tobytes(): row for row in genes if row.any() and row.tobytes() not in scored}
        wanted = list(new.values())[: evaluations - len(scored)]
        if wanted:
            for row, score in zip(wanted, objective(np.stack(wanted)), strict=True):
                scored[row.tobytes()] = (row, float(score))
        # An empty subset, or one beyond the allowed evaluations, must never become a parent.
        return [scored[row.tobytes()][1] if row.tobytes() in scored else -np.inf for row in genes]

    def enough(_: Any) -> str | None:
        return "stop" if len(scored) >= min(evaluations, 2**features - 1) else None

    with _global_state():
        pygad.GA(
            num_generations=10 * max(1, evaluations // population),
            sol_per_pop=population,
            num_parents_mating=population // 2,
            num_genes=features,
            gene_space=[0, 1],
            gene_type=int,
            parent_selection_type="tournament",
            crossover_type="uniform",
            mutation_probability=min(1.0, 1.5 / features),
            keep_elitism=max(1, population // 10),
            fitness_func=fitness,
            fitness_batch_size=population,
            on_generation=enough,
            random_seed=random_state,
            suppress_warnings=True,
        ).run()
    subsets, scores = zip(*scored.values(), strict=True)
    return SubsetSearch(np.stack(subsets), np.array(scores))


@contextmanager
def _global_state() -> Iterator[None]:
    """Restore the global generators, which the library seeds."""
    numpy_state, python_state = np.random.get_state(), random.getstate()  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(numpy_state)  # noqa: NPY002
        random.setstate(python_state)


def network_objective(
    samples: Samples,
    validation: Samples,
    *,
    hidden: int = 8,
    max_iter: int = 60,
    random_state: int = 0,
    **options: Any,
) -> Objective:
    """Return the objective: the validation accuracy of a network trained on the subset alone.

    Parameters
    ----------
    samples, validation
        Features, shape (n, k), and whether each sample is an emergency, shape (n,).
    hidden, max_iter
        Neurons and L-BFGS iterations of each network; the validation samples do not stop it.
    random_state
        Seed of the initial weights. All subsets share it, so they differ only in their features.
    options
        ``weight``, ``weight_decay`` and others of :func:`mavhums.learn.lbfgs.train_batch`.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    """

    def accuracies(subsets: Flags) -> Array:
        count = len(subsets)
        options_ = {"validation": validation, "max_iter": max_iter, "patience": None} | options
        trained = train_networks([hidden] * count, [random_state] * count, samples, subsets, **options_)
        return trained.validation_accuracy

    return accuracies
