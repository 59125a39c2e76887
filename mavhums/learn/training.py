"""Training a network: feature selection, training of several candidates, and choice of the best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import JsonValue

from mavhums.core.quantities import KEYS, column
from mavhums.core.version import __version__
from mavhums.learn.card import Card, Selection
from mavhums.learn.inference import Network
from mavhums.learn.network import TanhNetworkClassifier
from mavhums.learn.redundancy import PairwiseRedundancyFilter
from mavhums.learn.splits import hold_out

__all__ = ["Candidate", "TrainingResult", "select_features", "train_network"]


@dataclass(frozen=True)
class Candidate:
    """One trained network: its hidden neurons, its seed, and its accuracies, each within [0, 1]."""

    hidden: int
    seed: int
    training_accuracy: float
    validation_accuracy: float


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """The chosen network and its candidates.

    Attributes
    ----------
    network
        The candidate with the best validation accuracy.
    chosen
        The entry of the chosen network in ``candidates``.
    candidates
        All trained networks, in order of training.
    selection
        Chi-square, groups and selected keys.
    validation
        Unit of hold-out: ``"flights"`` or ``"blocks"`` of time.
    seed
        The seed given to :func:`train_network`.
    """

    network: Network
    chosen: Candidate
    candidates: tuple[Candidate, ...]
    selection: Selection
    validation: Literal["flights", "blocks"]
    seed: int

    @property
    def training_accuracy(self) -> float:
        """Fraction of the training samples that the network classifies correctly."""
        return self.chosen.training_accuracy

    @property
    def validation_accuracy(self) -> float:
        """Fraction of the held-out samples that the network classifies correctly."""
        return self.chosen.validation_accuracy

    def card(
        self,
        *,
        name: str,
        airframe: str,
        tier: str,
        command: str,
        conditions: Mapping[str, JsonValue] | None = None,
        metrics: Mapping[str, float] | None = None,
    ) -> Card:
        """Return the card for the model file: the training result plus the given entries."""
        found = {"training_accuracy": self.training_accuracy, "validation_accuracy": self.validation_accuracy}
        chosen: dict[str, JsonValue] = {
            "networks": len(self.candidates),
            "hidden": self.chosen.hidden,
            "validation": self.validation,
        }
        libraries = {package: version(package) for package in ("numpy", "scikit-learn", "scipy", "torch")}
        return Card(
            name=name,
            airframe=airframe,
            features=self.network.keys,
            tier=tier,
            conditions=chosen | dict(conditions or {}),
            metrics=found | dict(metrics or {}),
            selection=self.selection,
            seed=self.seed,
            command=command,
            versions={"mavhums": __version__} | libraries,
        )


def select_features(values: ArrayLike, emergency: ArrayLike, *, keys: Sequence[str] = KEYS) -> Selection:
    """Rank quantities by chi-square, and keep the best of each group of interdependent ones.

    Parameters
    ----------
    values
        V1…V12, shape (n, 12), finite in the columns of ``keys``.
    emergency
        Class of each sample, shape (n,).
    keys
        The quantities to choose from, those that the telemetry tier provides.

    Raises
    ------
    ValueError
        If the data are not as described, or no quantity varies.
    """
    columns = [column(key) for key in keys]
    redundancy = PairwiseRedundancyFilter().fit(np.asarray(values, dtype=np.float64)[:, columns], emergency)
    ranking = redundancy.ranking_
    return Selection(
        chi_square=dict(zip(keys, ranking.scores_.tolist(), strict=True)),
        p_values=dict(zip(keys, ranking.p_values_.tolist(), strict=True)),
        groups=tuple(tuple(keys[feature] for feature in group) for group in redundancy.groups_),
        selected=tuple(keys[feature] for feature in redundancy.get_support(indices=True)),
    )


def train_network(
    values: ArrayLike,
    emergency: ArrayLike,
    flights: ArrayLike,
    *,
    seed: int,
    networks: int = 10,
    hidden: Sequence[int] = range(4, 17),
    keys: Sequence[str] = KEYS,
    features: Sequence[str] | None = None,
    weights: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrainingResult:
    """Select features, train several networks on them, and choose one without test data.

    A quarter of the training data is held out; neither selection nor training uses it. If each
    class has at least two flights, whole flights are held out; a flight belongs to the class of
    most of its samples. With fewer flights, as in the paper's split, each flight is divided into
    twelve equal blocks of time, and whole blocks are held out. The validation accuracy is then
    optimistic, because the training blocks come from the same flights.

    Parameters
    ----------
    values
        V1…V12, shape (n, 12), the rows of each flight in time order; finite in the columns of
        ``keys``.
    emergency
        Whether each sample is of the emergency class, shape (n,).
    flights
        Number of the flight of each sample, shape (n,).
    seed
        Makes the result repeatable.
    networks
        Number of networks to train.
    hidden
        Numbers of hidden neurons; the networks cycle through them in shuffled order.
    keys
        The quantities to choose from, those that the telemetry tier provides.
    features
        Input quantities that replace the selected ones.
    weights
        Weight of each sample in training, positive, shape (n,); None gives equal weights.
        Selection and accuracies ignore them.
    progress
        Called after each network with the number trained and the total.

    Raises
    ------
    ValueError
        If the data are not as described, or a class has too few samples to hold some out.
    MissingExtraError
        If torch is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> flights = np.repeat([0, 1], 300)
    >>> values = np.random.default_rng(0).normal(size=(600, 12)) + 4 * flights[:, np.newaxis]
    >>> result = train_network(values, flights == 1, flights, seed=0, networks=2, keys=("V5", "V9"))
    >>> result.network.keys, result.validation, result.validation_accuracy > 0.95
    (('V5', 'V9'), 'blocks', True)
    """
    samples, labels, flight = _checked(values, emergency, flights, keys)
    if networks < 1 or not len(hidden):
        raise ValueError("networks must be at least 1, and hidden must hold at least one number")
    if features is not None and not set(features) <= set(keys):
        raise ValueError(f"features {tuple(features)} are not all among keys {tuple(keys)}")
    random = np.random.default_rng(seed)
    weight = None if weights is None else _checked_weights(weights, len(samples))
    held_out, validation = hold_out(labels, flight, random)
    selection = select_features(samples[~held_out], labels[~held_out], keys=keys)
    chosen_keys = selection.selected if features is None else tuple(features)
    inputs = samples[:, [column(key) for key in chosen_keys]]
    neurons = np.resize(random.permutation(np.asarray(hidden)), networks).tolist()
    seeds = random.integers(2**31 - 1, size=networks).tolist()
    trained = []
    for number, (size, network_seed) in enumerate(zip(neurons, seeds, strict=True), start=1):
        classifier = TanhNetworkClassifier(hidden=size, random_state=network_seed)
        classifier.fit(inputs[~held_out], labels[~held_out], None if weight is None else weight[~held_out])
        right = classifier.predict(inputs) == labels
        candidate = Candidate(
            size, network_seed, float(right[~held_out].mean()), float(right[held_out].mean())
        )
        trained.append((candidate, classifier.network_))
        if progress:
            progress(number, networks)
    chosen, network = max(trained, key=lambda pair: (pair[0].validation_accuracy, -pair[0].hidden))
    return TrainingResult(
        network=Network(keys=chosen_keys, **network.tensors),
        chosen=chosen,
        candidates=tuple(candidate for candidate, _ in trained),
        selection=selection,
        validation=validation,
        seed=seed,
    )


def _checked(
    values: ArrayLike, emergency: ArrayLike, flights: ArrayLike, keys: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.intp]]:
    samples = np.asarray(values, dtype=np.float64)
    labels = np.asarray(emergency)
    if samples.ndim != 2 or samples.shape[1] != len(KEYS):
        raise ValueError(f"values must have the shape (n, {len(KEYS)}), not {samples.shape}")
    if labels.shape != samples.shape[:1] or labels.dtype != np.bool_:
        raise ValueError("emergency must be one boolean for each sample")
    if np.shape(flights) != samples.shape[:1]:
        raise ValueError("flights must be one number for each sample")
    for key in keys:
        if not np.isfinite(samples[:, column(key)]).all():
            raise ValueError(f"{key} is not finite throughout; leave it out of keys, or drop those samples")
    return samples, labels, np.unique(np.asarray(flights), return_inverse=True)[1]


def _checked_weights(weights: ArrayLike, samples: int) -> NDArray[np.float64]:
    weight = np.asarray(weights, dtype=np.float64)
    if weight.shape != (samples,) or not (np.isfinite(weight).all() and (weight > 0).all()):
        raise ValueError("weights must be one positive number for each sample")
    return weight
