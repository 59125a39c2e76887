"""The wrapper of the paper's scheme (section 2): networks choose among the features that the filter kept.

A subset is worth the cross-entropy of its best network on the vectors held out. The fewest features within
one standard error of the least win (Breiman et al., 1984): what a subset gains beyond them is no more than
the draw of those vectors.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.errors import MissingExtraError
from mavhums.learn.card import Search, Wrapped
from mavhums.learn.inference import TanhNetwork
from mavhums.learn.trainer import NetworkOptions, Vectors, cross_entropies, train_networks

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


_QUICK = NetworkOptions(max_iter=60)


def network_objective(
    vectors: Vectors,
    validation: Vectors,
    *,
    hidden: int = 8,
    random_state: int = 0,
    options: NetworkOptions = _QUICK,
) -> Objective:
    """Return the objective: the validation accuracy of a network trained on the subset alone.

    Parameters
    ----------
    vectors, validation
        Those trained on, and those held out.
    hidden
        Neurons of each network.
    random_state
        Seed of the initial weights. All subsets share it, so they differ only in their features.
    options
        How each network is trained; the validation vectors do not stop it, whatever ``patience``.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    """
    to_the_end = replace(options, patience=None)

    def accuracies(subsets: Flags) -> Array:
        sizes, seeds = ([each] * len(subsets) for each in (hidden, random_state))
        trained = train_networks(sizes, seeds, vectors, validation, subsets=subsets, options=to_the_end)
        return trained.validation_accuracy

    return accuracies


_SAMPLES, _ITERATIONS, _HIDDEN = 1000, 60, 8
"""Size of the first round of the wrapper of samples, in which every subset has one small network."""

_SHORTLIST = 16
"""The best subsets of the first round compete again with all vectors: its noise is above their difference."""

_MANY = 10
"""Quantities beyond which their subsets are searched genetically, not all."""

COMPARED = NetworkOptions(weight_decay=2e-4, patience=100, beyond=0.005)
"""Of networks that are compared, and of those of windows. With less decay networks of the same data differ by
a tenth of their loss, and statistics by less."""

_SEEDS, _COMPARED_HIDDEN, _COMPARED_ITERATIONS = 3, 16, 300
"""Networks of each subset that is compared: one that started badly says nothing about its inputs."""


def search_subsets(
    vectors: Vectors, validation: Vectors, select: str, *, seed: int
) -> tuple[Flags, Wrapped, Array]:
    """Search the subset of features whose networks are best on the validation vectors.

    Every subset that is tried has one small network on some vectors. The best of them, and the
    whole set, compete again with larger networks on all vectors.

    Parameters
    ----------
    vectors, validation
        Training vectors, and those of other flights.
    select
        ``"exhaustive"`` or ``"genetic"`` prescribe the search; otherwise the number of features does.
    seed
        Of all draws.

    Returns
    -------
    Flags, Wrapped, NDArray
        Mask of the chosen features, shape (k,); what the card records; how much the loss on the validation
        vectors rises when each chosen feature is shuffled among them.

    Raises
    ------
    MissingExtraError
        If torch, or pygad for the genetic search, is not installed.
    """
    draw = np.random.default_rng(seed)
    features = vectors.features.shape[1]
    genetic = select == "genetic" or (select != "exhaustive" and features > _MANY)
    few = [part.part(draw.permutation(len(part))[:_SAMPLES]) for part in (vectors, validation)]
    quick = network_objective(
        *few, hidden=_HIDDEN, random_state=seed, options=NetworkOptions(max_iter=_ITERATIONS)
    )
    search = (
        genetic_search(quick, features, random_state=seed) if genetic else exhaustive_search(quick, features)
    )
    whole = np.ones((1, features), dtype=bool)
    best = search.subsets[np.argsort(-search.scores, kind="stable")[:_SHORTLIST]]
    shortlist = np.unique(np.concatenate([whole, best]), axis=0)
    compared = [_trained(subset, vectors, validation, draw, seed) for subset in shortlist]
    return _fewest(compared, "genetic" if genetic else "exhaustive", tried=len(search.scores))


def _rises(network: TanhNetwork, validation: Vectors, random: np.random.Generator) -> Array:
    """Return how much the mean loss rises when each feature's values are shuffled (Breiman, 2001), (k,)."""
    rises = np.zeros(validation.features.shape[1])
    for k in range(len(rises)):
        shuffled = validation.features.copy()
        shuffled[:, k] = random.permutation(shuffled[:, k])
        rises[k] = cross_entropies(network, replace(validation, features=shuffled)).mean()
    rises -= cross_entropies(network, validation).mean()
    return rises


class _Candidate(NamedTuple):
    """A subset, and of its best network the loss with its error, the accuracy and each feature's rise."""

    features: Flags
    loss: float
    error: float
    accuracy: float
    rises: Array


def _trained(
    subset: Flags, vectors: Vectors, validation: Vectors, draw: np.random.Generator, seed: int
) -> _Candidate:
    """Train networks on a subset, and return it with what the one of the least loss shows."""
    own, held_out = vectors.of_features(subset), validation.of_features(subset)
    trained = train_networks(
        [_COMPARED_HIDDEN] * _SEEDS,
        seed + np.arange(_SEEDS),
        own,
        held_out,
        options=replace(COMPARED, max_iter=_COMPARED_ITERATIONS),
    )
    place = int(trained.validation_loss.argmin())
    losses = cross_entropies(trained.networks[place], held_out)
    rises = np.full(len(subset), np.inf)
    rises[subset] = _rises(trained.networks[place], held_out, draw)
    error, accuracy = losses.std() / np.sqrt(len(losses)), float(trained.validation_accuracy[place])
    return _Candidate(subset, losses.mean(), error, accuracy, rises)


def _fewest(compared: Sequence[_Candidate], search: Search, *, tried: int) -> tuple[Flags, Wrapped, Array]:
    """Choose the fewest features within a standard error of the least loss; see :func:`search_subsets`."""
    best = min(compared, key=lambda each: each.loss)
    enough = (each for each in compared if each.loss <= best.loss + best.error)
    chosen = min(enough, key=lambda each: (int(each.features.sum()), each.loss))
    whole = next(each for each in compared if each.features.all())
    wrapped = Wrapped(
        search=search,
        tried=tried,
        possible=2 ** len(chosen.features) - 1,
        accuracy=round(chosen.accuracy, 6),
        accuracy_of_all=round(whole.accuracy, 6),
    )
    return chosen.features, wrapped, chosen.rises[chosen.features]


def eliminate(vectors: Vectors, validation: Vectors, *, seed: int) -> tuple[Flags, Wrapped, Array]:
    """Leave out one feature after the other, while the loss on the flights held out stays the same.

    Each step trains on the features that are left, and leaves out the one whose values, shuffled among the
    vectors held out, raise the loss least.

    Parameters
    ----------
    vectors, validation, seed
        As for :func:`search_subsets`, and what it returns.
    """
    draw, left = np.random.default_rng(seed), np.ones(vectors.features.shape[1], dtype=bool)
    compared: list[_Candidate] = []
    while left.any():
        compared.append(_trained(left.copy(), vectors, validation, draw, seed))
        left[compared[-1].rises.argmin()] = False
    return _fewest(compared, "elimination", tried=len(compared))
