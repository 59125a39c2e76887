"""Training by the paper's scheme, of samples in two classes and of windows in several: stages and choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import JsonValue
from sklearn.model_selection import GroupShuffleSplit

from mavhums.core.about import __version__
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, WINDOW_KEYS, column
from mavhums.learn.card import Card, Selection
from mavhums.learn.chain import Scheme, reduce_vectors, select_columns, select_features
from mavhums.learn.evaluation import hold_out, split_flights
from mavhums.learn.inference import Network, TanhNetwork
from mavhums.learn.networks import TanhNetworkEnsemble
from mavhums.learn.ranking import ChiSquareRanking
from mavhums.learn.trainer import train_networks
from mavhums.learn.wrapper import TRAINING, Vectors

_ITERATIONS = 300


@dataclass(frozen=True)
class NetworkScore:
    """One trained network: its hidden neurons, and its accuracies, each within [0, 1]."""

    hidden: int
    training_accuracy: float
    validation_accuracy: float


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """The chosen network and its candidates.

    Attributes
    ----------
    network
        The candidate with the least loss on the samples held out.
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
    chosen: NetworkScore
    candidates: tuple[NetworkScore, ...]
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
        conditions: Mapping[str, JsonValue],
    ) -> Card:
        """Return the card for the model file: the training result plus the given entries."""
        from torch.backends.cpu import get_cpu_capability

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
            conditions=chosen | dict(conditions),
            metrics={
                "training_accuracy": self.training_accuracy,
                "validation_accuracy": self.validation_accuracy,
            },
            selection=self.selection,
            seed=self.seed,
            command=command,
            # Sums in other vector instructions differ in the last digits, and another network follows.
            versions={"mavhums": __version__} | libraries | {"instructions": get_cpu_capability()},
        )


def train_network(
    values: ArrayLike,
    emergency: ArrayLike,
    flights: ArrayLike,
    *,
    seed: int,
    keys: Sequence[str] = KEYS,
    scheme: Scheme | None = None,
    weights: ArrayLike | None = None,
    tell: Callable[[str], None] | None = None,
) -> TrainingResult:
    """Run the paper's scheme (its figure 1) on labelled samples, and choose a network without test data.

    The stages: chi-square, a filter by regression, thinning of similar vectors, the unit interval and
    the class codes, the wrapper, and networks on the inputs that it chose. A quarter of the training
    data is held out for the wrapper and for the choice of the network; no other stage uses it. If each
    class has at least two flights, whole flights are held out; a flight belongs to the class of
    most of its samples. With fewer flights, as in the paper's split, each flight is divided into
    twelve equal blocks of time, and whole blocks are held out. The validation accuracy is optimistic:
    choices were made by it, and training blocks may come from the same flights.

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
    keys
        The quantities to choose from, those that the telemetry tier provides.
    scheme
        Options of the stages; None means the paper's.
    weights
        Weight of each sample in training, positive, shape (n,); None gives equal weights.
        Selection and accuracies ignore them.
    tell
        Called with a line about each stage when it is done.

    Raises
    ------
    MavhumsError
        If the scheme has more basis functions than can be regressed on.
    ValueError
        If the data are not as described, or a class has too few samples to hold some out.
    MissingExtraError
        If torch is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> flights = np.repeat([0, 1], 300)
    >>> values = np.random.default_rng(0).normal(size=(600, 12)) + 4 * flights[:, np.newaxis]
    >>> scheme = Scheme(networks=2, vectors=None)
    >>> result = train_network(values, flights == 1, flights, seed=0, keys=("V5", "V9"), scheme=scheme)
    >>> result.network.keys, result.validation, result.validation_accuracy > 0.95
    (('V5', 'V9'), 'blocks', True)
    """
    scheme = scheme or Scheme()
    samples, labels, flight = _checked(values, emergency, flights, keys)
    random = np.random.default_rng(seed)
    weight = np.ones(len(samples)) if weights is None else np.asarray(weights, dtype=np.float64)
    if weight.shape != labels.shape or not (np.isfinite(weight).all() and (weight > 0).all()):
        raise ValueError("weights must be one positive number for each sample")
    held_out, validation = hold_out(labels, flight, random)
    draw, say = int(random.integers(2**31 - 1)), tell or (lambda _: None)
    selection = select_features(samples[~held_out], labels[~held_out], keys=keys, scheme=scheme)
    everything = Vectors(samples[:, [column(key) for key in selection.selected]], labels, weight)
    offered, checked = everything.part(np.flatnonzero(~held_out)), everything.part(np.flatnonzero(held_out))
    vectors, chosen, selection = reduce_vectors(offered, checked, selection, scheme, seed=draw, tell=tell)
    parts = [part.of_features(chosen) for part in (vectors, offered, checked)]
    ensemble, candidates = _fit(parts, scheme, random)
    best = candidates[ensemble.best_]
    accuracies = [each.validation_accuracy for each in candidates]
    say(
        f"networks: {len(candidates)} of {min(scheme.hidden)} to {max(scheme.hidden)} tanh neurons; the best "
        f"with {best.hidden}: {100 * best.validation_accuracy:.2f} % of the samples held out (median "
        f"{100 * float(np.median(accuracies)):.2f} %, worst {100 * min(accuracies):.2f} %)"
    )
    return TrainingResult(
        network=Network(keys=selection.chosen(chosen), **ensemble.networks_[ensemble.best_].tensors),
        chosen=best,
        candidates=tuple(candidates),
        selection=selection,
        validation=validation,
        seed=seed,
    )


def _fit(
    parts: Sequence[Vectors], scheme: Scheme, random: np.random.Generator
) -> tuple[TanhNetworkEnsemble, list[NetworkScore]]:
    """Train the networks on vectors that represent the offered ones; those checked stop each early."""
    vectors, offered, checked = parts
    ensemble = TanhNetworkEnsemble(
        scheme.networks,
        random.permutation(np.asarray(scheme.hidden)).tolist(),
        random_state=int(random.integers(2**31 - 1)),
        max_iter=_ITERATIONS,
    ).fit(
        vectors.features,
        vectors.target,
        vectors.weight,
        validation=(checked.features, checked.target),
    )
    # Of the vectors, those at the border of the classes are many more than of the samples.
    trained = ensemble.member_scores(offered.features, offered.target)
    sizes = [len(network.b1) for network in ensemble.networks_]
    scores = zip(sizes, trained.tolist(), ensemble.validation_accuracies_.tolist(), strict=True)
    return ensemble, [NetworkScore(*each) for each in scores]


def _checked(
    values: ArrayLike, emergency: ArrayLike, flights: ArrayLike, keys: Sequence[str]
) -> tuple[Array, Flags, Integers]:
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


_HELD_OUT = 0.25
_SHARE = 5
"""Of the networks of samples, one in so many for windows: each has several times their weights."""
_WINDOW_HIDDEN = (16, 20, 24)
_WINDOW_ITERATIONS = 600


@dataclass(frozen=True, eq=False)
class LabelledWindows:
    """Windows of flights in known conditions.

    Attributes
    ----------
    features
        Their statistics, shape (n, k): those of :data:`~mavhums.core.quantities.WINDOW_KEYS`, or others.
    classes
        Index of each window's condition, shape (n,).
    flights
        Number of each window's flight, shape (n,); flights of the same number are never told apart.
    still
        Number of further windows that show nothing: standing, or a sag that the supply never limits.
    """

    features: Array
    classes: Integers
    flights: Integers
    still: int = field(default=0, kw_only=True)

    def __len__(self) -> int:
        return len(self.features)

    def part(self, rows: Integers | Flags) -> LabelledWindows:
        """Return some of the windows."""
        return LabelledWindows(self.features[rows], self.classes[rows], self.flights[rows])


@dataclass(frozen=True, eq=False)
class WindowResult:
    """The chosen network, its inputs, what the stages kept, and each candidate's neurons and accuracy."""

    network: TanhNetwork
    inputs: tuple[str, ...]
    selection: Selection
    candidates: tuple[tuple[int, float], ...]


def train_windows(
    windows: LabelledWindows,
    *,
    classes: int,
    keys: Sequence[str],
    seed: int,
    columns: Sequence[str] = WINDOW_KEYS,
    scheme: Scheme | None = None,
    weights: ArrayLike | None = None,
    tell: Callable[[str], None] | None = None,
) -> WindowResult:
    """Run the paper's stages on the statistics of windows, and choose a network without test data.

    Chi-square ranks the statistics (in bins of equal counts, for their tails are long), Algorithm 1 excludes
    those that others explain (linearly: they are of second order themselves), similar windows are thinned,
    and networks choose among subsets of the rest. A quarter of the flights is held out for the last two
    choices.

    Parameters
    ----------
    windows
        Labelled windows. Those that lack a statistic of ``keys`` train nothing; held out, they are guesses.
    classes
        Number of conditions.
    keys
        The statistics to choose from, those that the telemetry tier provides.
    columns
        Names of all statistics of ``windows``, in order.
    seed, scheme, weights, tell
        As for :func:`mavhums.learn.train_network`; a fifth of ``scheme.networks`` is trained.

    Raises
    ------
    MissingExtraError
        If torch, or pygad for the genetic search, is not installed.
    """
    scheme = scheme or Scheme()
    values = windows.features[:, [columns.index(key) for key in keys]]
    finite = np.asarray(np.isfinite(values).all(axis=1))
    weight = np.ones(len(values)) if weights is None else np.asarray(weights, dtype=np.float64)
    examples = LabelledWindows(values, windows.classes, windows.flights)
    split = GroupShuffleSplit(1, test_size=_HELD_OUT, random_state=seed)
    halves = next(split.split(examples.features, groups=examples.flights))
    known = np.unique(examples.classes[finite])
    if any(len(np.unique(examples.classes[half[finite[half]]])) < len(known) for half in halves):
        # Of few flights a draw easily leaves a class out of a part.
        halves = split_flights(examples.classes, examples.flights, seed=seed) or halves
    # The windows held out that lack a statistic show what it costs to need it.
    halves = halves[0][finite[halves[0]]], halves[1]
    offered, checked = map(examples.part, halves)
    ranking = ChiSquareRanking(strategy="quantile")
    selection = select_columns(offered.features, offered.classes, keys, replace(scheme, order=1), ranking)
    kept = [list(keys).index(key) for key in selection.selected]
    target, of_all = np.eye(classes, dtype=bool), offered.features[:, kept]
    vectors, held_out = (
        Vectors(part.features[:, kept], target[part.classes], weight[rows])
        for part, rows in zip((offered, checked), halves, strict=True)
    )
    vectors, chosen, selection = reduce_vectors(
        vectors, held_out, selection, scheme, seed=seed, eliminates=True, tell=tell
    )
    sizes = np.resize(_WINDOW_HIDDEN, max(1, scheme.networks // _SHARE)).tolist()
    inputs = selection.chosen(chosen)
    trained = train_networks(
        sizes,
        [seed + k for k in range(len(sizes))],
        vectors.of_features(chosen).samples,
        weight=vectors.weight,
        validation=held_out.of_features(chosen).samples,
        # Of all examples: those that thinning keeps span less than what the network may be asked.
        bounds=(of_all[:, chosen].min(axis=0), of_all[:, chosen].max(axis=0)),
        max_iter=_WINDOW_ITERATIONS,
        **TRAINING,
    )
    accuracies = trained.validation_accuracy
    if tell:
        tell(
            f"networks of windows: {len(sizes)} of {min(_WINDOW_HIDDEN)} to {max(_WINDOW_HIDDEN)} tanh "
            f"neurons; {100 * accuracies.max():.2f} % of the windows held out "
            f"(worst {100 * accuracies.min():.2f} %)"
        )
    best = trained.networks[int(np.argmin(trained.validation_loss))]
    return WindowResult(best, inputs, selection, tuple(zip(sizes, accuracies.tolist(), strict=True)))
