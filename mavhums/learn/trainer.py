"""Training of tanh networks by torch's L-BFGS, one after the other; torch is imported only to train."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike
from scipy.special import log_softmax

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MissingExtraError
from mavhums.learn.inference import TanhNetwork, unit_interval

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True, eq=False)
class Vectors:
    """Feature vectors, shape (n, k), and the class and weight of each.

    Attributes
    ----------
    target
        Whether each is an emergency, shape (n,), or of each of several classes, shape (n, classes).
    weight
        Not negative, shape (n,); None: each has weight 1.
    """

    features: Array
    target: Flags
    weight: Array | None = None

    def __len__(self) -> int:
        return len(self.features)

    @property
    def weights(self) -> Array:
        """The weight of each vector, shape (n,)."""
        return np.ones(len(self)) if self.weight is None else self.weight

    @property
    def classes(self) -> Integers | Flags:
        """The class of each vector as a label, shape (n,)."""
        return self.target if self.target.ndim == 1 else self.target.argmax(axis=1)

    @property
    def outputs(self) -> Integers:
        """The output that is the largest for each vector's class; of two the first is the emergency's."""
        return np.asarray(np.where(self.target, 0, 1) if self.target.ndim == 1 else self.classes)

    def part(self, rows: Integers | Flags) -> Vectors:
        """Return some of the vectors."""
        return Vectors(self.features[rows], self.target[rows], self.weights[rows])

    def of_features(self, chosen: Flags) -> Vectors:
        """Return the vectors with some of the features."""
        return replace(self, features=self.features[:, chosen])


@dataclass(frozen=True, eq=False)
class NetworkOptions:
    """How the weights of a network are found.

    Attributes
    ----------
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean cross-entropy.
    max_iter
        Maximum number of iterations; each uses all vectors.
    patience
        Early stopping: a network stops after this many iterations without a smaller validation loss, and its
        best weights are restored; None disables early stopping.
    beyond
        Share of each feature's values that lie below 0, and above 1, while the network learns: a few wild
        values would leave the others next to nothing of the interval. The network has the ``bounds``.
    bounds
        Minimum and maximum of each feature, shape (k,) each, which become 0 and 1; None takes those of the
        vectors with nonzero weight.
    n_jobs
        Number of threads, as in joblib. The result does not depend on it.
    """

    weight_decay: float = 1e-4
    max_iter: int = 200
    patience: int | None = 50
    beyond: float = 0.0
    bounds: tuple[Array, Array] | None = None
    n_jobs: int | None = None


@dataclass(frozen=True, eq=False)
class Trained:
    """Trained networks, length B, and arrays of shape (B,).

    Attributes
    ----------
    loss
        Mean cross-entropy over the training vectors.
    iterations
        Iterations of L-BFGS.
    validation_loss, validation_accuracy
        Loss and accuracy on the vectors held out; NaN without any.
    """

    networks: tuple[TanhNetwork, ...]
    loss: Array
    iterations: Integers
    validation_loss: Array
    validation_accuracy: Array


def cross_entropies(network: TanhNetwork, vectors: Vectors) -> Array:
    """Return the cross-entropy of each vector, shape (n,); one that lacks an input is a guess."""
    outputs = network.outputs(vectors.features)
    losses = -np.asarray(log_softmax(outputs, axis=1))[np.arange(len(vectors)), vectors.outputs]
    return np.where(np.isnan(losses), np.log(outputs.shape[1]), losses)


def accuracy(network: TanhNetwork, vectors: Vectors) -> float:
    """Return the share of the vectors that the network classifies right; one that lacks an input is wrong."""
    outputs = network.outputs(vectors.features)
    right = (outputs.argmax(axis=1) == vectors.outputs) & np.isfinite(outputs).all(axis=1)
    return float(right.mean())


def train_networks(
    hidden: ArrayLike,
    seeds: ArrayLike,
    vectors: Vectors,
    validation: Vectors | None = None,
    *,
    subsets: Flags | None = None,
    options: NetworkOptions = NetworkOptions(),
) -> Trained:
    """Train networks on the same vectors, each from its own initial weights.

    Parameters
    ----------
    hidden, seeds
        Hidden neurons of each network, and seed of its initial weights, length B.
    vectors, validation
        Those trained on, and those held out.
    subsets
        Mask of each network's features, shape (B, k); the others have zero weights. None: all features.
    options
        How each is trained.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    """
    try:
        import torch
    except ModuleNotFoundError as error:
        raise MissingExtraError("training", "train") from error
    sizes = np.asarray(hidden).tolist()
    weight, used = vectors.weights, vectors.weights > 0
    subsets = np.ones((len(sizes), vectors.features.shape[1]), dtype=bool) if subsets is None else subsets
    features, classes, share = vectors.features[used], vectors.outputs[used], weight[used] / weight.sum()
    minimum, maximum = options.bounds or (features.min(axis=0), features.max(axis=0))
    ends = [options.beyond, 1.0 - options.beyond]
    low, high = np.quantile(features, ends, axis=0) if options.beyond else (minimum, maximum)
    outputs = 2 if vectors.target.ndim == 1 else vectors.target.shape[1]

    def train(neurons: int, seed: int, subset: Flags) -> tuple[TanhNetwork, float, int, float, float]:
        model = _initial(int(subset.sum()), neurons, outputs, seed)

        def network() -> TanhNetwork:
            first, b1, last, b2 = (part.detach().numpy() for part in model.parameters())
            w1 = np.zeros((len(subset), neurons))
            w1[subset] = first.T
            learnt = TanhNetwork(minimum=low, maximum=high, w1=w1, b1=b1, w2=last.T, b2=b2)
            return learnt.within(minimum, maximum)

        iterations, best, best_at, best_loss = 0, None, 0, np.inf
        data = unit_interval(features, low, high)[:, subset], classes, share
        for iterations in _minimise(model, [*map(torch.from_numpy, data)], options):
            if validation is None or options.patience is None:
                continue
            found = network()
            held_out = cross_entropies(found, validation).mean()
            if held_out < best_loss:
                best, best_at, best_loss = found, iterations, held_out
            elif iterations - best_at >= options.patience:
                break
        best = best or network()
        loss = float(cross_entropies(best, vectors) @ weight / weight.sum())
        if validation is None:
            return best, loss, iterations, np.nan, np.nan
        validation_loss = float(cross_entropies(best, validation).mean())
        return best, loss, iterations, validation_loss, accuracy(best, validation)

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        done = Parallel(n_jobs=options.n_jobs, prefer="threads")(
            map(delayed(train), sizes, np.asarray(seeds).tolist(), subsets)
        )
    finally:
        torch.set_num_threads(threads)
    networks, *figures = zip(*done, strict=True)
    return Trained(networks, *map(np.array, figures))


def _initial(inputs: int, neurons: int, outputs: int, seed: int) -> torch.nn.Sequential:
    """Return a network with Glorot's uniform weights and biases; torch's own generator stays as it is."""
    import torch

    draw, layers = torch.Generator().manual_seed(seed), []
    for sizes in ((inputs, neurons), (neurons, outputs)):
        # On the device "meta" the layer draws no weights of its own.
        layer = torch.nn.Linear(*sizes, dtype=torch.float64, device="meta").to_empty(device="cpu")
        limit = (6 / sum(sizes)) ** 0.5
        for part in layer.parameters():
            torch.nn.init.uniform_(part, -limit, limit, generator=draw)
        layers.append(layer)
    return torch.nn.Sequential(layers[0], torch.nn.Tanh(), layers[1])


_LOOK_EVERY = 10


def _minimise(
    model: torch.nn.Sequential, data: Sequence[torch.Tensor], options: NetworkOptions
) -> Iterator[int]:
    """Train a network, and yield the number of iterations after every ten until it has converged.

    Parameters
    ----------
    model
        The network, whose weights change.
    data
        Features, shape (n, k), classes and weights, shape (n,); the sum of the weights is 1.
    options
        Weight decay and maximum number of iterations.
    """
    import torch

    features, classes, share = data
    weights = [part for part in model.parameters() if part.ndim == 2]
    optimiser = torch.optim.LBFGS(
        model.parameters(),
        max_eval=5 * _LOOK_EVERY,  # torch's own 5/4 cuts line searches short
        history_size=12,
        tolerance_grad=1e-5,
        tolerance_change=0,
        line_search_fn="strong_wolfe",
    )

    def closure() -> torch.Tensor:
        optimiser.zero_grad()
        entropy = torch.nn.functional.cross_entropy(model(features), classes, reduction="none") @ share
        loss: torch.Tensor = entropy + options.weight_decay / 2 * sum(part.square().sum() for part in weights)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss.detach()

    iterations, before = 0, np.inf
    while iterations < options.max_iter:
        optimiser.param_groups[0]["max_iter"] = min(_LOOK_EVERY, options.max_iter - iterations)
        loss = float(optimiser.step(closure))  # type: ignore[no-untyped-call]
        if loss >= before:  # of the start of this step and of the one before: it has converged
            break
        before, iterations = loss, optimiser.state[weights[0]]["n_iter"]
        yield iterations
