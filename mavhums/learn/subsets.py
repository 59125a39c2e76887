"""Wrapper methods: exhaustive and genetic search of the subset with the best network (paper, section 2)."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils import ClassifierTags, check_random_state

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MissingExtraError
from mavhums.learn._estimators import (
    SupportSelector,
    check_choice,
    check_positive_integers,
    train_networks,
    two_classes,
)
from mavhums.learn.evaluation import hold_out

if TYPE_CHECKING:
    from mavhums.learn.batched import Samples
    from mavhums.learn.trainer import Trained

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
    weight: Array | None = None,
    hidden: int = 8,
    max_iter: int = 60,
    weight_decay: float = 1e-4,
    n_jobs: int | None = None,
    random_state: int = 0,
) -> Objective:
    """Return the objective: the validation accuracy of a network trained on the subset alone.

    Parameters
    ----------
    samples, validation
        Features, shape (n, k), and whether each sample is an emergency, shape (n,).
    weight
        Weight of each sample in training, shape (n,); None gives equal weights.
    hidden, max_iter, weight_decay
        Settings of each network, trained by L-BFGS.
    n_jobs
        Number of threads, as in joblib.
    random_state
        Seed of the initial weights. All subsets share it, so they differ only in their features.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    """
    train = subset_training(
        samples,
        validation,
        weight=weight,
        hidden=hidden,
        max_iter=max_iter,
        weight_decay=weight_decay,
        n_jobs=n_jobs,
        random_state=random_state,
    )
    return lambda subsets: train(subsets).validation_accuracy


def subset_training(
    samples: Samples, validation: Samples, *, hidden: int, random_state: int, **options: Any
) -> Callable[[Flags], Trained]:
    """Return a function that trains a network on each of several subsets, shape (s, k), all from one seed.

    ``options`` go to :func:`mavhums.learn.trainer.train_batch`; without ``patience`` there, the validation
    samples do not stop the training.
    """
    options = {"patience": None} | options

    def train(subsets: Flags) -> Trained:
        count = len(subsets)
        return train_networks(
            [hidden] * count, [random_state] * count, samples, subsets, validation=validation, **options
        )

    return train


class NetworkSubsetSelector(SupportSelector):
    """Keep the subset of features whose network classifies the held-out flights best.

    Parameters
    ----------
    search
        ``"exhaustive"``: all 2^k - 1 subsets; ``"genetic"``: at most ``evaluations`` of them.
    evaluations
        Maximum number of subsets that the genetic algorithm scores.
    max_samples
        Maximum number of samples for training, and for validation, drawn at random; None for all.
    hidden, iterations, weight_decay
        Settings of the networks, trained by L-BFGS.
    n_jobs
        Number of threads, as in joblib.
    random_state
        Seed, generator or None, for all random draws.

    Attributes
    ----------
    search_
        Every scored subset and its score.
    support_
        The best subset, shape (n_features,).
    n_features_in_
        Number of features seen by :meth:`fit`.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 2.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> label = np.repeat([0, 1], 100)
    >>> features = np.column_stack([rng.normal(size=200), label + 0.1 * rng.normal(size=200)])
    >>> NetworkSubsetSelector(random_state=0).fit(features, label).get_support()
    array([False,  True])
    """

    search_: SubsetSearch

    def __init__(
        self,
        search: Literal["exhaustive", "genetic"] = "exhaustive",
        *,
        evaluations: int = 400,
        max_samples: int | None = 1000,
        hidden: int = 8,
        iterations: int = 60,
        weight_decay: float = 1e-4,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.search = search
        self.evaluations = evaluations
        self.max_samples = max_samples
        self.hidden = hidden
        self.iterations = iterations
        self.weight_decay = weight_decay
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> NetworkSubsetSelector:
        """Search the subsets.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            One of two classes for each sample, shape (n_samples,).
        groups
            Flight of each sample, shape (n_samples,); a quarter of each class's flights is held
            out for scoring. Without it single samples are held out, which is optimistic for flights.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described.
        MissingExtraError
            If torch, or pygad for the genetic search, is not installed.
        """
        check_choice(self, "search", ("exhaustive", "genetic"))
        check_positive_integers(self, "evaluations", "hidden", "iterations")
        values, target = self._checked(X, y)
        _, codes = two_classes(target)
        seed = int(check_random_state(self.random_state).randint(2**31 - 1))
        random = np.random.default_rng(seed)
        flights = np.arange(len(values)) if groups is None else np.unique(groups, return_inverse=True)[1]
        held_out, _ = hold_out(codes == 1, flights, random)
        objective = network_objective(
            self._drawn(values, codes == 1, np.flatnonzero(~held_out), random),
            self._drawn(values, codes == 1, np.flatnonzero(held_out), random),
            hidden=self.hidden,
            max_iter=self.iterations,
            weight_decay=self.weight_decay,
            n_jobs=self.n_jobs,
            random_state=seed,
        )
        features = values.shape[1]
        if self.search == "exhaustive":
            self.search_ = exhaustive_search(objective, features)
        else:
            self.search_ = genetic_search(
                objective, features, evaluations=self.evaluations, random_state=seed
            )
        self.support_ = self.search_.best
        return self

    def _drawn(
        self,
        values: Array,
        emergency: Flags,
        rows: Integers,
        random: np.random.Generator,
    ) -> Samples:
        if self.max_samples is not None and len(rows) > self.max_samples:
            rows = random.permutation(rows)[: self.max_samples]
        return values[rows], emergency[rows]

    def __sklearn_tags__(self) -> Any:
        """Declare a binary classification target."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags = ClassifierTags(multi_class=False)
        return tags
