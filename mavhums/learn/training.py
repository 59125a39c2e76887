"""Training by the paper's scheme, of samples in two classes and of windows in several: stages and choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import JsonValue
from sklearn.model_selection import GroupShuffleSplit
from sklearn.utils import check_random_state

from mavhums.core.about import __version__
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, WINDOW_KEYS, column
from mavhums.learn.card import Card, Selection
from mavhums.learn.chain import Stages, TrainingOptions, run_stages
from mavhums.learn.evaluation import hold_out, split_flights
from mavhums.learn.inference import Network, TanhNetwork
from mavhums.learn.trainer import NetworkOptions, Trained, Vectors, accuracy, train_networks
from mavhums.learn.wrapper import COMPARED

_ITERATIONS = 300


@dataclass(frozen=True)
class NetworkScore:
    """One trained network: its hidden neurons, and its accuracies, each within [0, 1]."""

    hidden: int
    training_accuracy: float
    validation_accuracy: float


NetworkT = TypeVar("NetworkT", bound=TanhNetwork)


@dataclass(frozen=True, eq=False)
class TrainingResult(Generic[NetworkT]):
    """The chosen network and its candidates.

    Attributes
    ----------
    network
        The candidate with the least loss on the samples, or windows, held out.
    inputs
        Keys of its inputs.
    chosen
        The entry of the chosen network in ``candidates``.
    candidates
        All trained networks, in order of training.
    selection
        Chi-square, groups and selected keys.
    validation
        Unit of hold-out: ``"flights"`` or ``"blocks"`` of time.
    seed
        The seed that was given.
    """

    network: NetworkT
    inputs: tuple[str, ...]
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
            features=self.inputs,
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
    options: TrainingOptions,
    *,
    weights: ArrayLike | None = None,
) -> TrainingResult[Network]:
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
        ``options.keys``.
    emergency
        Whether each sample is of the emergency class, shape (n,).
    flights
        Number of the flight of each sample, shape (n,).
    options
        Seed, quantities to choose from, and scheme.
    weights
        Weight of each sample in training, positive, shape (n,); None gives equal weights.
        Selection and accuracies ignore them.

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
    >>> from mavhums.learn import Scheme
    >>> flights = np.repeat([0, 1], 300)
    >>> values = np.random.default_rng(0).normal(size=(600, 12)) + 4 * flights[:, np.newaxis]
    >>> options = TrainingOptions(seed=0, keys=("V5", "V9"), scheme=Scheme(networks=2, vectors=None))
    >>> result = train_network(values, flights == 1, flights, options)
    >>> result.network.keys, result.validation, result.validation_accuracy > 0.95
    (('V5', 'V9'), 'blocks', True)
    """
    samples, labels, flight = _checked(values, emergency, flights, options.keys)
    scheme, random = options.scheme, np.random.default_rng(options.seed)
    weight = np.ones(len(samples)) if weights is None else np.asarray(weights, dtype=np.float64)
    if weight.shape != labels.shape or not (np.isfinite(weight).all() and (weight > 0).all()):
        raise ValueError("weights must be one positive number for each sample")
    held_out, validation = hold_out(labels, flight, random)
    draw = int(random.integers(2**31 - 1))
    everything = Vectors(samples[:, [column(key) for key in options.keys]], labels, weight)
    stages = run_stages(everything.part(~held_out), everything.part(held_out), replace(options, seed=draw))
    sizes = np.resize(random.permutation(np.asarray(scheme.hidden)), scheme.networks)
    seeds = check_random_state(int(random.integers(2**31 - 1))).randint(2**31 - 1, size=scheme.networks)
    trained = train_networks(
        sizes, seeds, stages.vectors, stages.checked, options=NetworkOptions(max_iter=_ITERATIONS)
    )

    def named(network: TanhNetwork) -> Network:
        return Network(keys=stages.inputs, **network.tensors)

    return replace(_chosen(trained, stages, options, "samples", named), validation=validation)


def _chosen(
    trained: Trained,
    stages: Stages,
    options: TrainingOptions,
    what: str,
    named: Callable[[TanhNetwork], NetworkT],
) -> TrainingResult[NetworkT]:
    """Choose the network of the least loss held out, and report its accuracy."""
    # Of the thinned vectors, those at the border of the classes are many more than of those offered.
    candidates = tuple(
        NetworkScore(len(network.b1), accuracy(network, stages.offered), held_out)
        for network, held_out in zip(trained.networks, trained.validation_accuracy.tolist(), strict=True)
    )
    place = int(trained.validation_loss.argmin())
    best, hidden = candidates[place], {each.hidden for each in candidates}
    sizes = " to ".join(map(str, sorted({min(hidden), max(hidden)})))
    right = 100 * trained.validation_accuracy
    options.report(
        f"networks: {len(candidates)} of {sizes} tanh neurons; the best with {best.hidden}: "
        f"{right[place]:.2f} % of the {what} held out (median {np.median(right):.2f} %, "
        f"worst {right.min():.2f} %)"
    )
    return TrainingResult(
        network=named(trained.networks[place]),
        inputs=stages.inputs,
        chosen=best,
        candidates=candidates,
        selection=stages.selection,
        validation="flights",
        seed=options.seed,
    )


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
        Number of each window's flight, shape (n,); flights of the same number are never separated.
    still
        Number of further windows that show nothing: at rest, or a sag that the supply never limits.
    """

    features: Array
    classes: Integers
    flights: Integers
    still: int = field(default=0, kw_only=True)

    def __len__(self) -> int:
        return len(self.features)


def train_windows(
    windows: LabelledWindows,
    classes: int,
    options: TrainingOptions,
    *,
    columns: Sequence[str] = WINDOW_KEYS,
    weights: ArrayLike | None = None,
) -> TrainingResult[TanhNetwork]:
    """Run the paper's stages on the statistics of windows, and choose a network without test data.

    Chi-square ranks the statistics (in bins of equal counts, for their tails are long), Algorithm 1 excludes
    those that others explain (linearly: they are of second order themselves), similar windows are thinned,
    and networks choose among subsets of the rest. A quarter of the flights is held out for the last two
    choices.

    Parameters
    ----------
    windows
        Labelled windows. Those that lack a statistic of ``options.keys`` train nothing; held out, they are
        guesses.
    classes
        Number of conditions.
    options
        Seed, statistics to choose from, and scheme; a fifth of its networks is trained.
    columns
        Names of all statistics of ``windows``, in order.
    weights
        As for :func:`mavhums.learn.train_network`.

    Raises
    ------
    MissingExtraError
        If torch, or pygad for the genetic search, is not installed.
    """
    values = windows.features[:, [columns.index(key) for key in options.keys]]
    finite = np.asarray(np.isfinite(values).all(axis=1))
    split = GroupShuffleSplit(1, test_size=_HELD_OUT, random_state=options.seed)
    halves = next(split.split(values, groups=windows.flights))
    known = np.unique(windows.classes[finite])
    if any(len(np.unique(windows.classes[half[finite[half]]])) < len(known) for half in halves):
        # Of few flights a draw easily leaves a class out of a part.
        halves = split_flights(windows.classes, windows.flights, seed=options.seed) or halves
    weight = None if weights is None else np.asarray(weights, dtype=np.float64)
    everything = Vectors(values, np.eye(classes, dtype=bool)[windows.classes], weight)
    # The windows held out that lack a statistic show what it costs to need it.
    offered, checked = everything.part(halves[0][finite[halves[0]]]), everything.part(halves[1])
    scheme = replace(options.scheme, order=1, bins="quantile", eliminates=True)
    stages = run_stages(offered, checked, replace(options, scheme=scheme))
    sizes = np.resize(_WINDOW_HIDDEN, max(1, scheme.networks // _SHARE))
    seen = stages.offered.features
    network_options = replace(
        COMPARED,
        # Of all vectors: those that thinning keeps span less than what the network may be asked.
        bounds=(seen.min(axis=0), seen.max(axis=0)),
        max_iter=_WINDOW_ITERATIONS,
    )
    trained = train_networks(
        sizes, options.seed + np.arange(len(sizes)), stages.vectors, stages.checked, options=network_options
    )
    return _chosen(trained, stages, options, "windows", lambda network: network)
