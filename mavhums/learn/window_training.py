"""Training of the network of windows: the paper's stages on their statistics, for several classes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax
from sklearn.model_selection import GroupShuffleSplit

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MissingExtraError
from mavhums.core.window_features import WINDOW_KEYS
from mavhums.learn.card import Selection
from mavhums.learn.chain import Rounds, Scheme, Vectors, reduce_vectors, select_columns
from mavhums.learn.inference import TanhNetwork, WindowNetwork
from mavhums.learn.ranking import ChiSquareRanking

__all__ = [
    "ClassesResult",
    "LabelledWindows",
    "WindowResult",
    "at_temperature",
    "decides_at",
    "train_classes",
    "train_windows",
]

_HELD_OUT = 0.25
_SHARE = 5
"""Of the networks of samples, one in so many for windows: each has several times their weights."""
_HIDDEN = (16, 20, 24)
_ITERATIONS, _DECAY = 600, 3e-5
_ROUNDS = Rounds(
    many=8,
    evaluations=200,
    shortlist=6,
    hidden=_HIDDEN[0],
    iterations=300,
    seeds=1,
    by_loss=True,  # the accuracies of good subsets differ by less than their scatter
    options={"weight_decay": _DECAY, "patience": 50, "precision": "double"},
)
_LEVELS = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995)
_SPARED = 0.7
"""Share of the allowed errors that the level may leave on the flights that it is chosen on: there the best of
several levels looks better than it is."""


@dataclass(frozen=True, eq=False)
class LabelledWindows:
    """Windows of flights in known conditions.

    Attributes
    ----------
    features
        Their statistics, shape (n, len(WINDOW_KEYS)).
    classes
        Index of each window's condition, shape (n,).
    flights
        Number of each window's flight, shape (n,); flights of the same number are never told apart.
    """

    features: Array
    classes: Integers
    flights: Integers

    def __len__(self) -> int:
        return len(self.features)

    def part(self, rows: Integers | Flags) -> LabelledWindows:
        """Return some of the windows."""
        return LabelledWindows(self.features[rows], self.classes[rows], self.flights[rows])


@dataclass(frozen=True, eq=False)
class WindowResult:
    """The chosen network, what the stages kept, and each candidate's accuracy on the flights held out."""

    network: WindowNetwork
    selection: Selection
    candidates: tuple[tuple[int, float], ...]


def train_windows(
    windows: LabelledWindows,
    *,
    classes: int,
    keys: Sequence[str],
    seed: int,
    scheme: Scheme | None = None,
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
        Labelled windows; those with a statistic of ``keys`` missing are left out.
    classes
        Number of conditions.
    keys
        The statistics to choose from, those that the telemetry tier provides.
    seed, scheme, tell
        As for :func:`mavhums.learn.train_network`; a fifth of ``scheme.networks`` is trained.

    Raises
    ------
    MissingExtraError
        If torch, or pygad for the genetic search, is not installed.
    """
    columns = [WINDOW_KEYS.index(key) for key in keys]
    finite: Flags = np.asarray(np.isfinite(windows.features[:, columns]).all(axis=1))
    whole = windows.part(finite)
    part = LabelledWindows(whole.features[:, columns], whole.classes, whole.flights)
    found = train_classes(part, classes=classes, names=keys, seed=seed, scheme=scheme, tell=tell)
    network = WindowNetwork(keys=found.inputs, **found.network.tensors)
    return WindowResult(network, found.selection, found.candidates)


@dataclass(frozen=True, eq=False)
class ClassesResult:
    """The chosen network, the names of its inputs, what the stages kept, and each candidate's accuracy."""

    network: TanhNetwork
    inputs: tuple[str, ...]
    selection: Selection
    candidates: tuple[tuple[int, float], ...]


def train_classes(
    examples: LabelledWindows,
    *,
    classes: int,
    names: Sequence[str],
    seed: int,
    scheme: Scheme | None = None,
    tell: Callable[[str], None] | None = None,
) -> ClassesResult:
    """Do the same with any finite features, shape (n, k), of these ``names``."""
    try:
        from mavhums.learn.trainer import NetworkBatch, train_batch
    except ModuleNotFoundError as error:
        raise MissingExtraError("training", "train") from error
    scheme = scheme or Scheme()
    split = GroupShuffleSplit(1, test_size=_HELD_OUT, random_state=seed)
    offered, checked = (
        examples.part(rows) for rows in next(split.split(examples.features, groups=examples.flights))
    )
    ranking = ChiSquareRanking(strategy="quantile")
    selection = select_columns(offered.features, offered.classes, names, replace(scheme, order=1), ranking)
    kept = [list(names).index(name) for name in selection.selected]
    target, of_all = np.eye(classes, dtype=bool), offered.features[:, kept]
    vectors, held_out = (
        Vectors(part.features[:, kept], target[part.classes], np.ones(len(part)))
        for part in (offered, checked)
    )
    vectors, chosen, selection = reduce_vectors(
        vectors, held_out, selection, scheme, seed=seed, rounds=_ROUNDS, tell=tell
    )
    sizes = np.resize(_HIDDEN, max(1, scheme.networks // _SHARE)).tolist()
    inputs = selection.chosen(chosen)
    trained = train_batch(
        NetworkBatch(
            sizes, np.ones((len(sizes), len(inputs)), dtype=bool), [seed + k for k in range(len(sizes))]
        ),
        vectors.of_features(chosen).samples,
        weight=vectors.weight,
        validation=held_out.of_features(chosen).samples,
        # Of all examples: those that thinning keeps span less than what the network may be asked.
        bounds=(of_all[:, chosen].min(axis=0), of_all[:, chosen].max(axis=0)),
        max_iter=_ITERATIONS,
        weight_decay=_DECAY,
        precision="double",
    )
    accuracies = trained.validation_accuracy
    if tell:
        tell(
            f"networks of windows: {len(sizes)} of {min(_HIDDEN)} to {max(_HIDDEN)} tanh neurons; "
            f"{100 * accuracies.max():.2f} % of the windows held out (worst {100 * accuracies.min():.2f} %)"
        )
    best = trained.networks[int(np.argmin(trained.validation_loss))]
    return ClassesResult(best, inputs, selection, tuple(zip(sizes, accuracies.tolist(), strict=True)))


def at_temperature(network: WindowNetwork, windows: LabelledWindows) -> tuple[WindowNetwork, float]:
    """Return the network with its outputs divided by the temperature that fits other flights, and that.

    References
    ----------
    C. Guo, G. Pleiss, Y. Sun, K. Weinberger: On Calibration of Modern Neural Networks, 2017.
    """
    rows = network.inside(windows.features)
    columns = [WINDOW_KEYS.index(key) for key in network.keys]
    outputs, truth = network.outputs(windows.features[rows][:, columns]), windows.classes[rows]

    def loss(log_temperature: float) -> float:
        found = log_softmax(outputs / np.exp(log_temperature), axis=1)
        return -float(found[np.arange(len(truth)), truth].mean())

    # Rounded, so that a solver's last digits do not enter the model's hash.
    temperature = round(float(np.exp(minimize_scalar(loss, bounds=(-3, 3), method="bounded").x)), 4)
    return replace(network, w2=network.w2 / temperature, b2=network.b2 / temperature), temperature


def decides_at(network: WindowNetwork, windows: LabelledWindows, goal: float) -> float:
    """Return the least probability from which at least the share ``goal`` of the decided windows is right."""
    found = network.probabilities(windows.features)
    inside = network.inside(windows.features)
    top, right = found.max(axis=1), found.argmax(axis=1) == windows.classes
    for level in _LEVELS:
        decided = inside & (top >= level)
        if decided.any() and right[decided].mean() >= 1 - _SPARED * (1 - goal):
            return level
    return _LEVELS[-1]
