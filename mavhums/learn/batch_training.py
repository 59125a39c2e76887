"""Training of many networks at once, divided over the cores; imported only for training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from joblib import Parallel, delayed
from numpy.typing import NDArray

from mavhums.learn.batched import Batch, Data, Problem
from mavhums.learn.inference import TanhNetwork
from mavhums.learn.optimisation import Samples, one_thread
from mavhums.learn.scaling import unit_interval
from mavhums.learn.solvers import adam, lbfgs

__all__ = ["Batch", "Optimiser", "Trained", "train_batch"]

_NEURONS_PER_PART = 2048

Optimiser = Literal["lbfgs", "adam"]


@dataclass(frozen=True, eq=False)
class Trained:
    """The trained networks of a batch, in the batch's order; arrays of shape (B,).

    Attributes
    ----------
    loss
        Mean cross-entropy over the training samples.
    iterations
        Iterations of L-BFGS, or epochs of Adam.
    validation_loss, validation_accuracy
        Loss and accuracy on the validation samples; NaN without validation samples.
    """

    networks: tuple[TanhNetwork, ...]
    loss: NDArray[np.float64]
    iterations: NDArray[np.int64]
    validation_loss: NDArray[np.float64]
    validation_accuracy: NDArray[np.float64]


def train_batch(
    batch: Batch,
    samples: Samples,
    *,
    weight: NDArray[np.float64] | None = None,
    validation: Samples | None = None,
    optimiser: Optimiser = "lbfgs",
    weight_decay: float = 1e-4,
    max_iter: int = 200,
    patience: int | None = 50,
    precision: Literal["single", "double"] = "single",
    device: str = "auto",
    n_jobs: int | None = None,
) -> Trained:
    """Train every network of a batch on the same samples.

    Parameters
    ----------
    batch
        The networks: hidden neurons, input features, seeds.
    samples, validation
        Features, shape (n, k), and whether each sample is an emergency, shape (n,). Features are
        scaled by the range of the samples with nonzero weight.
    weight
        Weight of each sample, not negative, shape (n,).
    optimiser, max_iter, weight_decay
        L-BFGS uses all samples in each iteration; Adam uses mini-batches, and its iteration is one
        epoch.
    patience
        Early stopping: a network stops after this many iterations without a smaller validation
        loss, and its best weights are restored; None disables early stopping.
    precision
        Floating-point precision of training; single is twice as fast, double is reproducible to
        the last digits.
    device
        ``"cpu"``, another torch device, or ``"auto"``: a GPU if one is available.
    n_jobs
        Number of threads, as in joblib; each trains its own networks. The result does not depend
        on it.
    """
    used = samples[0] if weight is None else samples[0][weight > 0]
    minimum, maximum = used.min(axis=0), used.max(axis=0)
    where = ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
    dtype = torch.float32 if precision == "single" else torch.float64

    def data_of(part: Samples, weights: NDArray[np.float64] | None = None) -> Data:
        scaled = unit_interval(part[0], minimum, maximum)
        return Data.of(scaled, part[1], weights, device=where, dtype=dtype)

    data = data_of(samples, weight)
    held_out = None if validation is None else data_of(validation)
    stopping_data = None if patience is None else held_out
    solve = lbfgs if optimiser == "lbfgs" else adam

    def train_part(networks: NDArray[np.int64]) -> tuple[list[TanhNetwork], list[list[float]]]:
        problem = Problem(batch.part(networks.tolist()), data, weight_decay)
        solution = solve(problem, max_iter=max_iter, validation=stopping_data, patience=patience or max_iter)
        figures = [problem.loss(solution.weights, data), solution.iterations]
        if held_out is not None:
            logits = problem.logits(solution.weights, held_out)
            figures += [
                problem.loss(solution.weights, held_out),
                (logits * held_out.sign > 0).double().mean(1),
            ]
        return problem.networks(solution.weights, minimum, maximum), [part.tolist() for part in figures]

    order = np.argsort(np.asarray(batch.hidden), kind="stable")
    parts = np.array_split(order, -(-sum(batch.hidden) // _NEURONS_PER_PART) or 1)
    if sum(batch.hidden) <= _NEURONS_PER_PART and len(batch) > 1:
        parts = np.array_split(order, 2)
    with one_thread():
        done = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(train_part)(part) for part in parts)
    networks: list[TanhNetwork] = [network for found, _ in done for network in found]
    figures = np.full((4, len(batch)), np.nan)
    for part, (_, found) in zip(parts, done, strict=True):
        figures[: len(found), part] = found
    position = np.empty(len(batch), dtype=np.int64)
    position[np.concatenate(parts)] = np.arange(len(batch))
    return Trained(
        networks=tuple(networks[place] for place in position),
        loss=figures[0],
        iterations=figures[1].astype(np.int64),
        validation_loss=figures[2],
        validation_accuracy=figures[3],
    )
