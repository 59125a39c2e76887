"""Many small tanh networks trained together as one tensor program, by L-BFGS; imported only for training.

The networks share the samples. They differ in their weights, numbers of hidden neurons and input
features; masks remove the neurons and features that a network does not have. Its outputs are
V·tanh(W x + b) + c, one for each class. With two classes the decision depends only on the difference of
the outputs, and weight decay makes their optimal weights opposite. Training therefore fits one output, the
difference: w2 = (v/2, -v/2), b2 = (c/2, -c/2).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import Literal

import numpy as np
import torch
from joblib import Parallel, delayed

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.learn.inference import TanhNetwork, unit_interval

_BLOCK = 1 << 19
"""Number of hidden activations computed at once; they fit into the processor's cache."""

Tensor = torch.Tensor

Samples = tuple[Array, Flags]
"""Features, shape (n, k), and whether each sample is an emergency, (n,), or of each class, (n, classes)."""


@dataclass(frozen=True, eq=False)
class Data:
    """Samples in the form that the tensor program uses.

    Attributes
    ----------
    features
        Features on the unit interval and a column of ones for the bias, shape (n, k + 1).
    target
        Two classes: 1 for an emergency, -1 otherwise, shape (1, n). More classes: 1 for the class of the
        sample, 0 for the others, shape (classes, n).
    weight
        Weight of each sample, shape (n,); the sum is 1.
    """

    features: Tensor
    target: Tensor
    weight: Tensor

    @classmethod
    def of(
        cls,
        scaled: Array,
        target: Flags,
        weight: Array | None = None,
        *,
        device: str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> Data:
        """Convert scaled features (n, k), classes as in :data:`Samples`, and weights (n,)."""
        weight = np.ones(len(scaled)) if weight is None else weight
        columns = np.column_stack([scaled, np.ones(len(scaled))])
        rows = np.where(target, 1.0, -1.0)[None] if target.ndim == 1 else target.T.astype(np.float64)
        parts = (columns, rows, weight / weight.sum())
        return cls(*(torch.tensor(part, dtype=dtype, device=device) for part in parts))

    def __len__(self) -> int:
        return len(self.weight)


@dataclass(frozen=True, eq=False)
class NetworkBatch:
    """The networks of a batch: hidden neurons, input features and seeds.

    Attributes
    ----------
    hidden
        Hidden neurons of each network, length B.
    subsets
        Mask of each network's input features, shape (B, k).
    seeds
        Seed of each network's initial weights, length B.
    """

    hidden: Sequence[int]
    subsets: Flags
    seeds: Sequence[int]

    def __len__(self) -> int:
        return len(self.hidden)

    def part(self, networks: Sequence[int]) -> NetworkBatch:
        """Return a subset of the networks."""
        hidden, seeds = ([values[i] for i in networks] for values in (self.hidden, self.seeds))
        return NetworkBatch(hidden, self.subsets[list(networks)], seeds)


class BatchLoss:
    """Loss and gradient of every network of a batch, as functions of the matrix of weights.

    Row i of the matrix, of shape (B, h·(k + 1) + m·h + m), holds W with its bias column, V and c of
    network i; h is the largest number of hidden neurons, m the number of outputs: 1 for two classes.

    Parameters
    ----------
    batch
        The networks.
    data
        The training samples.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean loss.
    """

    def __init__(self, batch: NetworkBatch, data: Data, weight_decay: float) -> None:
        self.batch, self.data = batch, data
        self.width, self.inputs = max(batch.hidden), batch.subsets.shape[1]
        self.outputs = len(data.target)
        neurons = torch.arange(self.width)[None, :] < torch.tensor(list(batch.hidden))[:, None]
        seen = torch.tensor(np.column_stack([batch.subsets, np.ones(len(batch), dtype=bool)]))
        masks = [
            (neurons[:, :, None] & seen[:, None, :]).flatten(1),
            neurons.repeat(1, self.outputs),
            torch.ones(len(batch), self.outputs),
        ]
        self.mask = torch.cat([part.to(data.features) for part in masks], dim=1)
        penalty = torch.full((self.width, self.inputs + 1), float(weight_decay))
        penalty[:, -1] = 0
        # The one output of two classes stands for two of half its weights: v²/4 + v²/4 = v²/2.
        last = torch.full((self.outputs * self.width,), weight_decay / (2 if self.outputs == 1 else 1))
        self.penalty = torch.cat([penalty.flatten(), last, torch.zeros(self.outputs)]).to(data.features)

    def initial(self) -> Tensor:
        """Draw Glorot's uniform weights; each network uses its own seed, independent of the batch."""
        weights = torch.zeros_like(self.mask)
        for row, (hidden, seed) in enumerate(zip(self.batch.hidden, self.batch.seeds, strict=True)):
            draw = torch.Generator().manual_seed(int(seed))
            seen = np.flatnonzero(np.append(self.batch.subsets[row], True))
            first = (torch.rand(hidden, len(seen), generator=draw) * 2 - 1) * (
                6 / (len(seen) + hidden)
            ) ** 0.5
            classes = max(2, self.outputs)
            last = torch.rand(classes, hidden + 1, generator=draw)
            last = last.diff(dim=0) * 2 if self.outputs == 1 else last * 2 - 1
            last = last * (6 / (hidden + classes)) ** 0.5
            w1, v, c = (part[0] for part in self._split(weights[row : row + 1]))
            w1[:hidden, seen], v[:, :hidden], c[:] = first.to(w1), last[:, :-1].to(v), last[:, -1].to(c)
        return weights

    def evaluate(self, weights: Tensor, networks: Tensor) -> tuple[Tensor, Tensor]:
        """Return loss, shape (R,), and gradient, the shape of ``weights``, of some networks.

        Parameters
        ----------
        weights
            Rows of the networks, shape (R, …).
        networks
            Indices of these networks in the batch, shape (R,).
        """
        data = self.data
        w1, v, c = self._split(weights)
        loss = (weights.square() @ self.penalty) / 2
        gradient = weights * self.penalty
        g1, gv, gc = self._split(gradient)
        for rows in self._blocks(len(weights), len(data)):
            features, target, share = data.features[rows], data.target[:, rows], data.weight[rows]
            hidden = self._hidden(w1, features)
            logits = torch.bmm(v, hidden) + c[:, :, None]
            loss += _cross_entropy(logits, target) @ share
            delta = _slope(logits, target).mul_(share)
            # One output as a vector, not as a matrix of one column, whose product has other last digits.
            gv += torch.bmm(hidden, delta[:, 0, :, None] if self.outputs == 1 else delta.mT).mT
            gc += delta.sum(dim=2)
            inner = hidden.square_().neg_().add_(1)
            if self.outputs == 1:
                inner.mul_(delta).mul_(v.mT)
            else:
                inner.mul_(torch.bmm(v.mT, delta))
            g1 += (inner.flatten(0, 1) @ features).view_as(g1)
        return loss, gradient.mul_(self.mask[networks])

    def logits(self, weights: Tensor, data: Data) -> Tensor:
        """Return the m outputs of each network, shape (B, m, n)."""
        w1, v, c = self._split(weights)
        parts = [
            torch.bmm(v, self._hidden(w1, data.features[rows])) + c[:, :, None]
            for rows in self._blocks(len(weights), len(data))
        ]
        return torch.cat(parts, dim=2)

    def loss(self, weights: Tensor, data: Data) -> Tensor:
        """Return the mean cross-entropy of each network, without decay, shape (B,)."""
        return _cross_entropy(self.logits(weights, data), data.target) @ data.weight

    def accuracy(self, weights: Tensor, data: Data) -> Tensor:
        """Return the share of the samples that each network classifies correctly, shape (B,)."""
        logits = self.logits(weights, data)
        if self.outputs == 1:
            return (logits * data.target > 0).double().mean(dim=(1, 2))
        return (logits.argmax(dim=1) == data.target.argmax(dim=0)).double().mean(dim=1)

    def networks(self, weights: Tensor, minimum: Array, maximum: Array) -> list[TanhNetwork]:
        """Return each network as a numpy-only network with all k features as inputs."""
        w1, v, c = (part.cpu().numpy().astype(np.float64) for part in self._split(weights))
        if self.outputs == 1:
            v, c = np.concatenate([v, -v], axis=1) / 2, np.concatenate([c, -c], axis=1) / 2
        return [
            TanhNetwork(
                minimum=minimum,
                maximum=maximum,
                w1=w1[row, :hidden, :-1].T,
                b1=w1[row, :hidden, -1],
                w2=v[row, :, :hidden].T,
                b2=c[row],
            )
            for row, hidden in enumerate(self.batch.hidden)
        ]

    def _split(self, weights: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        first = self.width * (self.inputs + 1)
        matrix = weights[:, :first].view(len(weights), self.width, self.inputs + 1)
        v = weights[:, first : -self.outputs].view(len(weights), self.outputs, self.width)
        return matrix, v, weights[:, -self.outputs :]

    def _hidden(self, w1: Tensor, features: Tensor) -> Tensor:
        return (w1.flatten(0, 1) @ features.T).tanh_().view(len(w1), self.width, len(features))

    def _blocks(self, networks: int, samples: int) -> list[slice]:
        size = max(64, _BLOCK // (networks * self.width))
        return [slice(start, start + size) for start in range(0, samples, size)]


def _cross_entropy(logits: Tensor, target: Tensor) -> Tensor:
    """Return the cross-entropy of each sample, shape (B, n), of outputs of shape (B, m, n)."""
    if len(target) == 1:
        return torch.nn.functional.softplus(-logits * target)[:, 0]
    return -(torch.log_softmax(logits, dim=1) * target).sum(dim=1)


def _slope(logits: Tensor, target: Tensor) -> Tensor:
    """Return the derivative of the cross-entropy by the outputs, shape (B, m, n)."""
    if len(target) == 1:
        return torch.sigmoid(-logits * target).mul_(-target)
    return torch.softmax(logits, dim=1) - target


_MEMORY = 12
_HALVINGS = 12
_DESCENT = 1e-4
_LOOK_EVERY = 10


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
