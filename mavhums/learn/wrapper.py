"""Subset search as a scikit-learn selector; its objective trains networks in one batch."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import ClassifierTags, check_random_state

from mavhums.core.errors import MissingExtraError
from mavhums.learn._classified import SupportSelector
from mavhums.learn._parameters import check_choice, check_positive_integers, two_classes
from mavhums.learn.splits import hold_out
from mavhums.learn.subsets import Objective, SubsetSearch, exhaustive_search, genetic_search

__all__ = ["NetworkSubsetSelector", "network_objective"]

_Samples = tuple[NDArray[np.float64], NDArray[np.bool_]]


def network_objective(
    samples: _Samples,
    validation: _Samples,
    *,
    weight: NDArray[np.float64] | None = None,
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
    try:
        from mavhums.learn.batch_training import Batch, train_batch
    except ModuleNotFoundError as error:
        raise MissingExtraError("training", "train") from error

    def score(subsets: NDArray[np.bool_]) -> NDArray[np.float64]:
        trained = train_batch(
            Batch([hidden] * len(subsets), subsets, [random_state] * len(subsets)),
            samples,
            weight=weight,
            validation=validation,
            patience=None,
            max_iter=max_iter,
            weight_decay=weight_decay,
            n_jobs=n_jobs,
        )
        return trained.validation_accuracy

    return score


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
        values: NDArray[np.float64],
        emergency: NDArray[np.bool_],
        rows: NDArray[np.intp],
        random: np.random.Generator,
    ) -> _Samples:
        if self.max_samples is not None and len(rows) > self.max_samples:
            rows = random.permutation(rows)[: self.max_samples]
        return values[rows], emergency[rows]

    def __sklearn_tags__(self) -> Any:
        """Declare a binary classification target."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags = ClassifierTags(multi_class=False)
        return tags
