"""Training of tanh networks by torch's L-BFGS, one after the other; torch is imported only to train."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from joblib import Parallel, delayed
from scipy.special import log_softmax

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MissingExtraError
from mavhums.learn.inference import TanhNetwork, unit_interval

if TYPE_CHECKING:
    import torch

Samples = tuple[Array, Flags]
"""Features, shape (n, k), and whether each sample is an emergency, (n,), or of each class, (n, classes)."""


@dataclass(frozen=True, eq=False)
class Trained:
    """Trained networks, length B, and arrays of shape (B,).

    Attributes
    ----------
    loss
        Mean cross-entropy over the training samples.
    iterations
        Iterations of L-BFGS.
    validation_loss, validation_accuracy
        Loss and accuracy on the validation samples; NaN without validation samples.
    """

    networks: tuple[TanhNetwork, ...]
    loss: Array
    iterations: Integers
    validation_loss: Array
    validation_accuracy: Array


def class_of(target: Flags) -> Integers:
    """Return the index of each sample's class, shape (n,); of two classes the emergency is the first."""
    return np.asarray(np.where(target, 0, 1) if target.ndim == 1 else target.argmax(axis=1))


def cross_entropies(network: TanhNetwork, samples: Samples) -> Array:
    """Return the cross-entropy of each sample, shape (n,); one that lacks an input is a guess."""
    classes, outputs = class_of(samples[1]), network.outputs(samples[0])
    losses = -np.asarray(log_softmax(outputs, axis=1))[np.arange(len(classes)), classes]
    return np.where(np.isnan(losses), np.log(outputs.shape[1]), losses)


def train_networks(
    hidden: Sequence[int],
    seeds: Sequence[int],
    samples: Samples,
    subsets: Flags | None = None,
    *,
    weight: Array | None = None,
    validation: Samples | None = None,
    bounds: tuple[Array, Array] | None = None,
    beyond: float = 0.0,
    weight_decay: float = 1e-4,
    max_iter: int = 200,
    patience: int | None = 50,
    n_jobs: int | None = None,
) -> Trained:
    """Train networks on the same samples, each from its own initial weights.

    Parameters
    ----------
    hidden, seeds
        Hidden neurons of each network, and seed of its initial weights, length B.
    samples, validation
        Features, shape (n, k), and whether each sample is an emergency, shape (n,), or of each of
        several classes, shape (n, classes).
    subsets
        Mask of each network's features, shape (B, k); the others have zero weights. None: all features.
    weight
        Weight of each sample, not negative, shape (n,).
    bounds
        Minimum and maximum of each feature, shape (k,) each, which become 0 and 1; None takes those of the
        samples with nonzero weight.
    beyond
        Share of each feature's values that lie below 0, and above 1, while the networks learn: a few wild
        values would leave the others next to nothing of the interval. The networks have the ``bounds``.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean cross-entropy.
    max_iter
        Maximum number of iterations; each uses all samples.
    patience
        Early stopping: a network stops after this many iterations without a smaller validation
        loss, and its best weights are restored; None disables early stopping.
    n_jobs
        Number of threads, as in joblib. The result does not depend on it.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    """
    try:
        import torch
    except ModuleNotFoundError as error:
        raise MissingExtraError("training", "train") from error
    subsets = np.ones((len(hidden), samples[0].shape[1]), dtype=bool) if subsets is None else subsets
    weight = np.ones(len(samples[0])) if weight is None else weight
    used = weight > 0
    features, classes, share = samples[0][used], class_of(samples[1])[used], weight[used] / weight.sum()
    minimum, maximum = bounds or (features.min(axis=0), features.max(axis=0))
    low, high = np.quantile(features, [beyond, 1.0 - beyond], axis=0) if beyond else (minimum, maximum)
    outputs = 2 if samples[1].ndim == 1 else samples[1].shape[1]

    def train(neurons: int, seed: int, subset: Flags) -> tuple[TanhNetwork, float, int, float, float]:
        model = _initial(int(subset.sum()), neurons, outputs, int(seed))

        def network() -> TanhNetwork:
            first, b1, last, b2 = (part.detach().numpy() for part in model.parameters())
            w1 = np.zeros((len(subset), neurons))
            w1[subset] = first.T
            learnt = TanhNetwork(minimum=low, maximum=high, w1=w1, b1=b1, w2=last.T, b2=b2)
            return learnt.within(minimum, maximum)

        iterations, best, best_at, best_loss = 0, None, 0, np.inf
        data = unit_interval(features, low, high)[:, subset], classes, share
        for iterations in _minimise(model, [*map(torch.from_numpy, data)], weight_decay, max_iter):
            if validation is None or patience is None:
                continue
            found = network()
            held_out = cross_entropies(found, validation).mean()
            if held_out < best_loss:
                best, best_at, best_loss = found, iterations, held_out
            elif iterations - best_at >= patience:
                break
        best = best or network()
        loss = float(cross_entropies(best, samples) @ weight / weight.sum())
        if validation is None:
            return best, loss, iterations, np.nan, np.nan
        answers = best.outputs(validation[0])
        right = (answers.argmax(axis=1) == class_of(validation[1])) & np.isfinite(answers).all(axis=1)
        return best, loss, iterations, float(cross_entropies(best, validation).mean()), float(right.mean())

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        done = Parallel(n_jobs=n_jobs, prefer="threads")(map(delayed(train), hidden, seeds, subsets))
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
    model: torch.nn.Sequential, data: Sequence[torch.Tensor], weight_decay: float, max_iter: int
) -> Iterator[int]:
    """Train a network, and yield the number of iterations after every ten until it has converged.

    Parameters
    ----------
    model
        The network, whose weights change.
    data
        Features, shape (n, k), classes and weights, shape (n,); the sum of the weights is 1.
    weight_decay, max_iter
        As for :func:`train_networks`.
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
        loss: torch.Tensor = entropy + weight_decay / 2 * sum(part.square().sum() for part in weights)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss.detach()

    iterations, before = 0, np.inf
    while iterations < max_iter:
        optimiser.param_groups[0]["max_iter"] = min(_LOOK_EVERY, max_iter - iterations)
        loss = float(optimiser.step(closure))  # type: ignore[no-untyped-call]
        if loss >= before:  # of the start of this step and of the one before: it has converged
            break
        before, iterations = loss, optimiser.state[weights[0]]["n_iter"]
        yield iterations
