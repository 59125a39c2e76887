"""Training of the network of windows: the paper's stages on their statistics, for several classes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax
from sklearn.model_selection import GroupShuffleSplit

from mavhums.core.errors import MissingExtraError
from mavhums.core.window_features import WINDOW_KEYS
from mavhums.learn.chain import Scheme, select_columns
from mavhums.learn.inference import WindowNetwork
from mavhums.learn.ranking import ChiSquareRanking
from mavhums.learn.scaling import unit_interval
from mavhums.learn.selection import Selection, Thinned, Wrapped
from mavhums.learn.subsets import exhaustive_search, genetic_search
from mavhums.learn.thinning import VectorThinning

__all__ = ["LabelledWindows", "WindowResult", "at_temperature", "decides_at", "train_windows"]

_HELD_OUT = 0.25
_MANY, _EVALUATIONS = 8, 200
_FIRST_VECTORS, _FIRST_ITERATIONS, _FIRST_HIDDEN = 1000, 60, 8
_SHORTLIST, _SECOND_ITERATIONS = 6, 300
_SHARE = 5
"""Of the networks of samples, one in so many for windows: each has several times their weights."""
_HIDDEN = (16, 20, 24)
_ITERATIONS, _DECAY = 600, 3e-5
_LEVELS = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995)
_SPARED = 0.7
"""Share of the allowed errors that the level may leave on the flights that it is chosen on: there the best of
several levels looks better than it is."""

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


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
    classes: Rows
    flights: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.features)

    def part(self, rows: Rows | NDArray[np.bool_]) -> LabelledWindows:
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
    scheme, say = scheme or Scheme(), tell or (lambda _: None)
    columns = [WINDOW_KEYS.index(key) for key in keys]
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(windows.features[:, columns]).all(axis=1))
    whole = windows.part(finite)
    split = GroupShuffleSplit(1, test_size=_HELD_OUT, random_state=seed)
    offered, checked = (whole.part(rows) for rows in next(split.split(whole.features, groups=whole.flights)))
    ranking = ChiSquareRanking(strategy="quantile")
    linear = replace(scheme, order=1)
    selection = select_columns(offered.features[:, columns], offered.classes, keys, linear, ranking)
    for line in selection.told():
        say(line)
    kept = np.array([WINDOW_KEYS.index(key) for key in selection.selected])
    minimum, maximum = (end(offered.features[:, kept], axis=0) for end in (np.min, np.max))
    vectors, weight = _thinned(_Vectors.of(offered, kept, minimum, maximum, classes), scheme.vectors, seed)
    held_out = _Vectors.of(checked, kept, minimum, maximum, classes)
    selection = selection.model_copy(update={"thinned": Thinned(offered=len(offered), kept=len(weight))})
    chosen = np.ones(len(kept), dtype=bool)
    if scheme.select != "none" and len(kept) > 1:
        chosen, wrapped = _wrap(vectors, weight, held_out, scheme, seed)
        selection = selection.model_copy(update={"wrapped": wrapped})
    inputs = tuple(key for key, used in zip(selection.selected, chosen, strict=True) if used)
    for line in selection.told(inputs)[len(selection.told()) - 1 :]:
        say(line)
    vectors, held_out = vectors.of_columns(chosen), held_out.of_columns(chosen)
    candidates, best = [], None
    for k in range(max(1, scheme.networks // _SHARE)):
        hidden = _HIDDEN[k % len(_HIDDEN)]
        weights, loss, accuracy = _train(vectors, weight, held_out, hidden, _ITERATIONS, seed + k)
        candidates.append((hidden, accuracy))
        if best is None or loss < best[0]:
            best = loss, weights
    assert best is not None
    say(
        f"networks of windows: {len(candidates)} of {min(_HIDDEN)} to {max(_HIDDEN)} tanh neurons; "
        f"{100 * max(accuracy for _, accuracy in candidates):.2f} % of the windows held out (worst "
        f"{100 * min(accuracy for _, accuracy in candidates):.2f} %)"
    )
    network = WindowNetwork(keys=inputs, minimum=minimum[chosen], maximum=maximum[chosen], **best[1])
    return WindowResult(network, selection, tuple(candidates))


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


@dataclass(frozen=True, eq=False)
class _Vectors:
    """Inputs on the unit interval, shape (n, k), and whether each is of each class, shape (n, classes)."""

    inputs: Array
    target: NDArray[np.bool_]

    @classmethod
    def of(
        cls, windows: LabelledWindows, kept: Rows, minimum: Array, maximum: Array, classes: int
    ) -> _Vectors:
        scaled = unit_interval(windows.features[:, kept], minimum, maximum)
        return cls(scaled, windows.classes[:, None] == np.arange(classes))

    def of_columns(self, chosen: NDArray[np.bool_]) -> _Vectors:
        return _Vectors(self.inputs[:, chosen], self.target)


def _thinned(vectors: _Vectors, count: int | None, seed: int) -> tuple[_Vectors, Array]:
    if count is None or count >= len(vectors.inputs):
        return vectors, np.ones(len(vectors.inputs))
    thinning = VectorThinning(count, random_state=seed)
    thinning.fit(vectors.inputs, vectors.target.argmax(axis=1))
    return _Vectors(vectors.inputs[thinning.indices_], vectors.target[thinning.indices_]), thinning.weights_


def _train(
    vectors: _Vectors, weight: Array, checked: _Vectors, hidden: int, iterations: int, seed: int
) -> tuple[dict[str, Array], float, float]:
    """Return weights, and loss and accuracy on the vectors held out, which also stop the training early."""
    try:
        from mavhums.learn.optimisation import train
    except ModuleNotFoundError as error:
        raise MissingExtraError("training", "train") from error
    held_out = checked.inputs, checked.target
    found = train(
        (vectors.inputs, vectors.target),
        hidden=hidden,
        weight_decay=_DECAY,
        max_iter=iterations,
        seed=seed,
        weight=weight,
        validation=held_out,
    )
    weights = {"w1": found.w1, "b1": found.b1, "w2": found.w2, "b2": found.b2}
    outputs = np.tanh(checked.inputs @ found.w1 + found.b1) @ found.w2 + found.b2
    loss = -float(log_softmax(outputs, axis=1)[checked.target].mean())
    return weights, loss, float(checked.target[np.arange(len(outputs)), outputs.argmax(axis=1)].mean())


def _wrap(
    vectors: _Vectors, weight: Array, checked: _Vectors, scheme: Scheme, seed: int
) -> tuple[NDArray[np.bool_], Wrapped]:
    """Search the subset of statistics whose networks are best; the best compete again with all vectors."""
    random = np.random.default_rng(seed)
    features = vectors.inputs.shape[1]
    few = random.permutation(len(weight))[:_FIRST_VECTORS]
    seen = random.permutation(len(checked.inputs))[:_FIRST_VECTORS]
    part = _Vectors(vectors.inputs[few], vectors.target[few])
    look = _Vectors(checked.inputs[seen], checked.target[seen])

    def trained(
        one: NDArray[np.bool_], some: _Vectors, weight: Array, others: _Vectors, size: tuple[int, int]
    ) -> tuple[float, float]:
        return _train(some.of_columns(one), weight, others.of_columns(one), *size, seed)[1:]

    def quick(subsets: NDArray[np.bool_]) -> Array:
        size = _FIRST_HIDDEN, _FIRST_ITERATIONS
        return np.array([trained(one, part, weight[few], look, size)[1] for one in subsets])

    genetic = scheme.select == "genetic" or (scheme.select != "exhaustive" and features > _MANY)
    if genetic:
        search = genetic_search(quick, features, evaluations=_EVALUATIONS, random_state=seed)
    else:
        search = exhaustive_search(quick, features)
    best = search.subsets[np.argsort(-search.scores, kind="stable")[:_SHORTLIST]]
    shortlist = np.unique(np.concatenate([np.ones((1, features), dtype=bool), best]), axis=0)
    size = _HIDDEN[0], _SECOND_ITERATIONS
    final = [trained(one, vectors, weight, checked, size) for one in shortlist]
    # By loss: the accuracies of good subsets differ by less than their scatter.
    chosen = int(np.argmin([loss for loss, _ in final]))
    wrapped = Wrapped(
        search="genetic" if genetic else "exhaustive",
        tried=len(search.scores),
        possible=2**features - 1,
        accuracy=round(final[chosen][1], 6),
        accuracy_of_all=round(final[int(shortlist.all(axis=1).argmax())][1], 6),
    )
    return shortlist[chosen], wrapped
