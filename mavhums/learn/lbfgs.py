"""The trainer: L-BFGS for a batch of networks, divided over the cores; only for training."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import Literal

import numpy as np
import torch
from joblib import Parallel, delayed

from mavhums.core.arrays import Array, Integers
from mavhums.learn.batched import BatchLoss, Data, NetworkBatch, Samples
from mavhums.learn.inference import TanhNetwork, unit_interval

_MEMORY = 12
_HALVINGS = 12
_DESCENT = 1e-4
_LOOK_EVERY = 10

Tensor = torch.Tensor


class Solution:
    """Each network's weights, shape (B, …), and number of iterations, shape (B,).

    With validation samples the weights are those with the smallest validation loss so far, and a
    network stops after ``patience`` iterations without a smaller one.
    """

    def __init__(self, problem: BatchLoss, validation: Data | None, patience: int) -> None:
        self.problem, self.validation, self.patience = problem, validation, patience
        self.weights = problem.initial()
        self.iterations = torch.zeros(len(self.weights), dtype=torch.int64)
        self._best, self._best_at = self.weights.clone(), torch.zeros_like(self.iterations)
        self._best_loss = torch.full((len(self.weights),), torch.inf).to(self.weights)

    def look(self, running: Tensor) -> None:
        """Update the best weights, and clear ``running``, shape (B,), for networks that stop early."""
        if self.validation is None:
            return
        loss = self.problem.loss(self.weights, self.validation)
        better = running & (loss < self._best_loss).cpu()
        self._best[better] = self.weights[better]
        self._best_loss[better] = loss[better]
        self._best_at[better] = self.iterations[better]
        running &= self.iterations - self._best_at < self.patience

    def finish(self) -> Solution:
        """Restore the best weights."""
        if self.validation is not None:
            self.weights = self._best
        return self


def lbfgs(
    problem: BatchLoss,
    *,
    max_iter: int,
    validation: Data | None = None,
    patience: int = 50,
    tolerance: float = 1e-5,
) -> Solution:
    """Minimise each network's loss by L-BFGS with backtracking (J. Nocedal, S. Wright, chapter 7).

    Parameters
    ----------
    problem
        Loss and gradient.
    max_iter
        Maximum number of iterations of each network.
    validation, patience
        See :class:`Solution`; evaluated every tenth iteration.
    tolerance
        A network has converged when its largest gradient component is below this.
    """
    solution = Solution(problem, validation, patience)
    every = torch.arange(len(problem.batch))
    running = torch.ones(len(every), dtype=torch.bool)
    loss, gradient = problem.evaluate(solution.weights, every)
    history: list[tuple[Tensor, Tensor, Tensor]] = []
    for iteration in range(1, max_iter + 1):
        running &= (gradient.abs().amax(dim=1) > tolerance).cpu()
        if not running.any():
            break
        direction = _direction(gradient, history)
        rows = every[running]
        step, new_loss, new_gradient = _backtrack(problem, solution.weights, loss, gradient, direction, rows)
        change = torch.zeros_like(direction)
        change[rows] = step[:, None] * direction[rows]
        difference = torch.zeros_like(gradient)
        difference[rows] = new_gradient - gradient[rows]
        curvature = (change * difference).sum(dim=1)
        sound = curvature > 1e-10 * difference.square().sum(dim=1)
        history = [*history[-_MEMORY + 1 :], (change, difference, torch.where(sound, 1 / curvature, 0))]
        solution.weights += change
        loss[rows], gradient[rows] = new_loss, new_gradient
        running[rows[(step == 0).cpu()]] = False
        solution.iterations[rows] = iteration
        if iteration % _LOOK_EVERY == 0 or iteration == max_iter:
            solution.look(running)
    solution.look(running.fill_(True))
    return solution.finish()


def _direction(gradient: Tensor, history: list[tuple[Tensor, Tensor, Tensor]]) -> Tensor:
    """Return the quasi-Newton direction by the two-loop recursion, for all networks at once."""
    found = -gradient
    if not history:
        return found / gradient.abs().sum(dim=1, keepdim=True).clamp(min=1)
    factors = []
    for change, difference, rho in reversed(history):
        factor = rho * (change * found).sum(dim=1)
        found = found - factor[:, None] * difference
        factors.append(factor)
    scale = torch.ones_like(history[0][2])
    for _, difference, rho in history:
        scale = torch.where(rho > 0, 1 / (rho * difference.square().sum(dim=1)), scale)
    found = found * scale[:, None]
    for (change, difference, rho), factor in zip(history, reversed(factors), strict=True):
        found = found + (factor - rho * (difference * found).sum(dim=1))[:, None] * change
    uphill = (found * gradient).sum(dim=1, keepdim=True) >= 0
    return torch.where(uphill, -gradient, found)


def _backtrack(
    problem: BatchLoss, weights: Tensor, loss: Tensor, gradient: Tensor, direction: Tensor, rows: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Halve each network's step until its loss decreases enough; a step of 0 means that it never did."""
    slope = (direction[rows] * gradient[rows]).sum(dim=1)
    step = torch.zeros_like(slope)
    new_loss, new_gradient = loss[rows].clone(), gradient[rows].clone()
    waiting = torch.arange(len(rows))
    size = 1.0
    for _ in range(_HALVINGS):
        those = rows[waiting]
        tried_loss, tried_gradient = problem.evaluate(weights[those] + size * direction[those], those)
        fine = (tried_loss <= loss[those] + _DESCENT * size * slope[waiting]).cpu()
        taken = waiting[fine]
        step[taken], new_loss[taken], new_gradient[taken] = size, tried_loss[fine], tried_gradient[fine]
        waiting = waiting[~fine]
        if not len(waiting):
            break
        size /= 2
    return step, new_loss, new_gradient


_NEURONS_PER_PART = 2048


@dataclass(frozen=True, eq=False)
class Trained:
    """The trained networks of a batch, in the batch's order; arrays of shape (B,).

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


def train_batch(
    batch: NetworkBatch,
    samples: Samples,
    *,
    weight: Array | None = None,
    validation: Samples | None = None,
    bounds: tuple[Array, Array] | None = None,
    beyond: float = 0.0,
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
        Features, shape (n, k), and whether each sample is an emergency, shape (n,), or of each of
        several classes, shape (n, classes).
    weight
        Weight of each sample, not negative, shape (n,).
    bounds
        Minimum and maximum of each feature, shape (k,) each, which become 0 and 1; None takes those of the
        samples with nonzero weight.
    beyond
        Share of each feature's values that lie below 0, and above 1, while the networks learn: a few wild
        values would leave the others next to nothing of the interval. The networks have the ``bounds``.
    max_iter, weight_decay
        L-BFGS uses all samples in each iteration.
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
    minimum, maximum = bounds or (used.min(axis=0), used.max(axis=0))
    where = ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
    dtype = torch.float32 if precision == "single" else torch.float64

    low, high = np.quantile(used, [beyond, 1.0 - beyond], axis=0) if beyond else (minimum, maximum)

    def data_of(part: Samples, weights: Array | None = None) -> Data:
        scaled = unit_interval(part[0], low, high)
        return Data.of(scaled, part[1], weights, device=where, dtype=dtype)

    data = data_of(samples, weight)
    held_out = None if validation is None else data_of(validation)
    stopping_data = None if patience is None else held_out

    def train_part(networks: Integers) -> list[tuple[TanhNetwork, float, int, float, float]]:
        problem = BatchLoss(batch.part(networks.tolist()), data, weight_decay)
        solution = lbfgs(problem, max_iter=max_iter, validation=stopping_data, patience=patience or max_iter)
        figures = [problem.loss(solution.weights, data), solution.iterations]
        for measure in (problem.loss, problem.accuracy):
            unknown = torch.full((len(networks),), torch.nan)
            figures.append(unknown if held_out is None else measure(solution.weights, held_out))
        within = [each.within(minimum, maximum) for each in problem.networks(solution.weights, low, high)]
        return list(zip(within, *(figure.tolist() for figure in figures), strict=True))

    order = np.argsort(np.asarray(batch.hidden), kind="stable")
    parts = np.array_split(order, -(-sum(batch.hidden) // _NEURONS_PER_PART) or 1)
    if sum(batch.hidden) <= _NEURONS_PER_PART and len(batch) > 1:
        parts = np.array_split(order, 2)
    with one_thread():
        done = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(train_part)(part) for part in parts)
    trained = [*chain.from_iterable(done)]
    networks, *figures = zip(*(trained[place] for place in np.argsort(order)), strict=True)
    return Trained(networks, *map(np.array, figures))


@contextmanager
def one_thread() -> Iterator[None]:
    """Make torch compute each operation on one thread, then restore the previous setting."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
