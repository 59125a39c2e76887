"""The wrapper of the paper's scheme: networks choose among the features that the filter kept.

The fewest features within one standard error of the best win (Breiman et al., 1984): what a subset gains
beyond them is no more than the draw of the vectors held out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import log_softmax

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.learn._estimators import train_networks
from mavhums.learn.card import Wrapped
from mavhums.learn.inference import TanhNetwork
from mavhums.learn.subsets import exhaustive_search, genetic_search, network_objective

_SAMPLES, _ITERATIONS, _HIDDEN = 1000, 60, 8
"""Size of the first round of the wrapper of samples, in which every subset has one small network."""

_SHORTLIST, _SECOND_ITERATIONS, _SECOND_HIDDEN, _SEEDS = 16, 150, 12, 3
"""The best subsets of the first round compete again with all vectors: its noise is above their difference.
Each has several networks: one that started badly says nothing about its inputs."""

_MANY = 10
"""Quantities beyond which their subsets are searched genetically, not all."""

WINDOW_TRAINING: Mapping[str, Any] = {
    "weight_decay": 2e-4,
    "patience": 100,
    "precision": "double",
    "beyond": 0.005,
}
"""With less decay networks of the same data differ by a tenth of their loss, and statistics by less."""

_STEP_HIDDEN, _STEP_ITERATIONS = 16, 300
"""Size of the network of each step of the wrapper of windows."""


@dataclass(frozen=True, eq=False)
class Vectors:
    """Feature vectors, shape (n, k), and the class and weight of each.

    ``target`` says whether each is an emergency, shape (n,), or of each class, shape (n, classes).
    """

    features: Array
    target: Flags
    weight: Array

    def __len__(self) -> int:
        return len(self.features)

    @property
    def samples(self) -> tuple[Array, Flags]:
        """Features and classes, as the trainer takes them."""
        return self.features, self.target

    def part(self, rows: Integers) -> Vectors:
        """Return some of the vectors."""
        return Vectors(self.features[rows], self.target[rows], self.weight[rows])

    def of_features(self, chosen: Flags) -> Vectors:
        """Return the vectors with some of the features."""
        return replace(self, features=self.features[:, chosen])


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
        Mask of the chosen features, shape (k,); what the card tells; how much the loss on the validation
        vectors rises when each chosen feature is shuffled among them.

    Raises
    ------
    MissingExtraError
        If torch, or pygad for the genetic search, is not installed.
    """
    random = np.random.default_rng(seed)
    features = vectors.features.shape[1]
    genetic = select == "genetic" or (select != "exhaustive" and features > _MANY)
    few = [part.part(random.permutation(len(part))[:_SAMPLES]) for part in (vectors, validation)]
    quick = network_objective(
        few[0].samples,
        few[1].samples,
        weight=few[0].weight,
        hidden=_HIDDEN,
        max_iter=_ITERATIONS,
        random_state=seed,
    )
    search = (
        genetic_search(quick, features, random_state=seed) if genetic else exhaustive_search(quick, features)
    )
    whole = np.ones((1, features), dtype=bool)
    best = search.subsets[np.argsort(-search.scores, kind="stable")[:_SHORTLIST]]
    shortlist = np.unique(np.concatenate([whole, best]), axis=0)
    trained = [
        train_networks(
            [_SECOND_HIDDEN] * len(shortlist),
            [seed + k] * len(shortlist),
            vectors.samples,
            shortlist,
            validation=validation.samples,
            weight=vectors.weight,
            max_iter=_SECOND_ITERATIONS,
            patience=None,
        )
        for k in range(_SEEDS)
    ]
    accuracies = np.array([each.validation_accuracy for each in trained])
    most, best_of = accuracies.max(), accuracies.max(axis=0)
    enough = best_of >= most - np.sqrt(most * (1.0 - most) / len(validation))
    place = np.lexsort([-best_of, shortlist.sum(axis=1), ~enough])[0]
    chosen = shortlist[place]
    rises = _rises(trained[accuracies[:, place].argmax()].networks[place], validation, random)
    wrapped = Wrapped(
        search="genetic" if genetic else "exhaustive",
        tried=len(search.scores),
        possible=2**features - 1,
        accuracy=round(float(best_of[place]), 6),
        accuracy_of_all=round(float(best_of[shortlist.all(axis=1)][0]), 6),
    )
    return chosen, wrapped, rises[chosen]


def _losses(network: TanhNetwork, features: Array, target: Flags) -> Array:
    """Return the cross-entropy of each vector, shape (n,)."""
    classes = (~target).astype(int) if target.ndim == 1 else target.argmax(axis=1)  # emergency comes first
    log_probabilities: Array = log_softmax(network.outputs(features), axis=1)
    losses: Array = -log_probabilities[np.arange(len(classes)), classes]
    return losses


def _rises(network: TanhNetwork, validation: Vectors, random: np.random.Generator) -> Array:
    """Return how much the mean loss rises when each feature's values are shuffled (Breiman, 2001)."""
    rises = np.zeros(validation.features.shape[1])
    for k in range(len(rises)):
        shuffled = validation.features.copy()
        shuffled[:, k] = random.permutation(shuffled[:, k])
        rises[k] = _losses(network, shuffled, validation.target).mean()
    rises -= _losses(network, validation.features, validation.target).mean()
    return rises


class _Step(NamedTuple):
    """The features of a step, and of its best network the loss with its error, the accuracy and the rises."""

    loss: float
    error: float
    features: Flags
    accuracy: float
    rises: Array


def eliminate(vectors: Vectors, validation: Vectors, *, seed: int) -> tuple[Flags, Wrapped, Array]:
    """Leave out one feature after the other, while the loss on the flights held out stays the same.

    Each step trains on the features that are left, and leaves out the one whose values, shuffled among the
    vectors held out, raise the loss least.

    Parameters
    ----------
    vectors, validation, seed
        As for :func:`search_subsets`, and what it returns.
    """
    random, left = np.random.default_rng(seed), np.ones(vectors.features.shape[1], dtype=bool)
    steps: list[_Step] = []
    while left.any():
        trained = train_networks(
            [_STEP_HIDDEN] * _SEEDS,
            [seed + k for k in range(_SEEDS)],
            vectors.samples,
            np.repeat(left[None], _SEEDS, axis=0),
            validation=validation.samples,
            weight=vectors.weight,
            max_iter=_STEP_ITERATIONS,
            **WINDOW_TRAINING,
        )
        place = int(trained.validation_loss.argmin())
        losses = _losses(trained.networks[place], validation.features, validation.target)
        rises = _rises(trained.networks[place], validation, random)
        error, accuracy = losses.std() / np.sqrt(len(losses)), float(trained.validation_accuracy[place])
        steps.append(_Step(losses.mean(), error, left.copy(), accuracy, rises))
        left[np.where(left, rises, np.inf).argmin()] = False
    best = min(steps, key=lambda step: step.loss)
    chosen = next(step for step in reversed(steps) if step.loss <= best.loss + best.error)
    wrapped = Wrapped(
        search="elimination",
        tried=len(steps),
        possible=2 ** len(chosen.features) - 1,
        accuracy=round(chosen.accuracy, 6),
        accuracy_of_all=round(steps[0].accuracy, 6),
    )
    return chosen.features, wrapped, chosen.rises[chosen.features]
