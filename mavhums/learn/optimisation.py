"""Training of one network's weights with torch; imported only for training."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

__all__ = ["Samples", "Training", "one_thread", "train"]

_ROUND = 10
"""Iterations between two evaluations of the validation loss."""

Samples = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Features, shape (n, k), and whether each sample is an emergency, (n,), or of each class, (n, classes)."""


@dataclass(frozen=True, eq=False)
class Training:
    """Weights as in :class:`mavhums.learn.inference.TanhNetwork`, and the training result."""

    w1: NDArray[np.float64]
    b1: NDArray[np.float64]
    w2: NDArray[np.float64]
    b2: NDArray[np.float64]
    loss: float
    iterations: int


def train(
    samples: Samples,
    *,
    hidden: int,
    weight_decay: float,
    max_iter: int,
    seed: int,
    weight: NDArray[np.float64] | None = None,
    validation: Samples | None = None,
    patience: int = 50,
) -> Training:
    """Minimise cross-entropy plus weight decay by L-BFGS with a strong Wolfe line search.

    Parameters
    ----------
    samples
        Features on the unit interval, shape (n, k), and whether each is an emergency, shape (n,); or
        of more than two classes whether it is of each, shape (n, classes).
    hidden
        Neurons in the hidden layer.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean loss.
    max_iter
        Maximum number of iterations.
    seed
        Seed of the initial weights; torch's global random state is neither read nor changed.
    weight
        Weight of each sample, shape (n,); None gives all samples equal weight.
    validation
        If given, training stops after ``patience`` iterations without a smaller loss on these
        samples, and the weights with the smallest such loss are returned.

    Returns
    -------
    Training
        Computed on one thread, so the number of cores does not affect the sums.
    """
    generator = torch.Generator().manual_seed(seed)
    features, target = _tensors(samples)
    inputs, outputs = features.shape[1], target.shape[1]
    weights = [
        (torch.rand(shape, generator=generator, dtype=torch.float64) * 2 - 1).mul_(bound).requires_grad_()
        for shape, bound in (
            ((inputs, hidden), (6 / (inputs + hidden)) ** 0.5),
            ((hidden,), (6 / (inputs + hidden)) ** 0.5),
            ((hidden, outputs), (6 / (hidden + outputs)) ** 0.5),
            ((outputs,), (6 / (hidden + outputs)) ** 0.5),
        )
    ]
    held_out = _tensors(validation) if validation else None
    share = None if weight is None else torch.tensor(weight / weight.sum())
    # The limit on evaluations must never end a round: a shortened round looks like convergence.
    optimiser = torch.optim.LBFGS(
        weights,
        max_iter=_ROUND,
        max_eval=1000 * _ROUND,
        history_size=20,
        line_search_fn="strong_wolfe",
        tolerance_grad=1e-6,
    )

    def closure() -> torch.Tensor:
        optimiser.zero_grad()
        decay = weights[0].square().sum() + weights[2].square().sum()
        loss = _cross_entropy(weights, features, target, share) + weight_decay / 2 * decay
        torch.autograd.backward(loss)
        return loss.detach()

    best, best_loss, best_iteration, iterations = _copy(weights), float("inf"), 0, 0
    with one_thread():
        while iterations < max_iter:
            allowed = min(_ROUND, max_iter - iterations)
            optimiser.param_groups[0]["max_iter"] = allowed
            optimiser.step(closure)  # type: ignore[no-untyped-call]
            done = optimiser.state[weights[0]]["n_iter"] - iterations
            iterations += done
            if held_out:
                with torch.no_grad():
                    loss = float(_cross_entropy(weights, *held_out))
                if loss < best_loss:
                    best, best_loss, best_iteration = _copy(weights), loss, iterations
                elif iterations - best_iteration >= patience:
                    break
            if done < allowed:
                break
        final = best if held_out else _copy(weights)
        with torch.no_grad():
            loss = float(_cross_entropy(final, features, target, share))
    w1, b1, w2, b2 = (weight.numpy() for weight in final)
    return Training(w1=w1, b1=b1, w2=w2, b2=b2, loss=loss, iterations=iterations)


def _tensors(samples: Samples) -> tuple[torch.Tensor, torch.Tensor]:
    features, target = samples
    labels = target if target.ndim == 2 else np.column_stack([target, ~target])
    return torch.tensor(features, dtype=torch.float64), torch.tensor(labels, dtype=torch.float64)


def _cross_entropy(
    weights: list[torch.Tensor],
    features: torch.Tensor,
    target: torch.Tensor,
    share: torch.Tensor | None = None,
) -> torch.Tensor:
    w1, b1, w2, b2 = weights
    outputs = torch.tanh(features @ w1 + b1) @ w2 + b2
    if share is None:
        return torch.nn.functional.cross_entropy(outputs, target)
    return torch.nn.functional.cross_entropy(outputs, target, reduction="none") @ share


def _copy(weights: list[torch.Tensor]) -> list[torch.Tensor]:
    return [weight.detach().clone() for weight in weights]


@contextmanager
def one_thread() -> Iterator[None]:
    """Make torch compute each operation on one thread, then restore the previous setting."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
