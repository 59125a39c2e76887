"""Adam and L-BFGS for a batch of networks; each has its own step size, history and stopping point."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from mavhums.learn.batched import Data, Problem

__all__ = ["Solution", "adam", "lbfgs"]

_MEMORY = 12
_HALVINGS = 12
_DESCENT = 1e-4

Tensor = torch.Tensor


@dataclass(eq=False)
class Solution:
    """Each network's weights, shape (B, …), and number of iterations, shape (B,).

    With validation samples the weights are those with the smallest validation loss so far, and a
    network stops after ``patience`` iterations without a smaller one.
    """

    problem: Problem
    validation: Data | None
    patience: int
    weights: Tensor
    iterations: Tensor
    _best: Tensor = field(init=False)
    _best_loss: Tensor = field(init=False)
    _best_at: Tensor = field(init=False)

    @classmethod
    def start(cls, problem: Problem, validation: Data | None, patience: int) -> Solution:
        """Draw the initial weights."""
        weights = problem.initial()
        solution = cls(problem, validation, patience, weights, torch.zeros(len(weights), dtype=torch.int64))
        solution._best = weights.clone()
        solution._best_loss = torch.full((len(weights),), torch.inf).to(weights)
        solution._best_at = torch.zeros_like(solution.iterations)
        return solution

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
    problem: Problem,
    *,
    max_iter: int,
    validation: Data | None = None,
    patience: int = 50,
    look_every: int = 10,
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
        See :class:`Solution`; evaluated every ``look_every`` iterations.
    tolerance
        A network has converged when its largest gradient component is below this.
    """
    solution = Solution.start(problem, validation, patience)
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
        if iteration % look_every == 0 or iteration == max_iter:
            solution.look(running)
    solution.look(running.fill_(True))
    return solution.finish()


def adam(
    problem: Problem,
    *,
    max_iter: int,
    batch_size: int = 200,
    learning_rate: float = 1e-2,
    seed: int = 0,
    validation: Data | None = None,
    patience: int = 20,
) -> Solution:
    """Minimise each network's loss by Adam; an iteration is one epoch over the shuffled samples.

    Parameters
    ----------
    problem
        Loss and gradient.
    max_iter
        Maximum number of epochs; cosine annealing reduces the step from ``learning_rate`` to zero.
    batch_size
        Samples per step; all networks use the same mini-batches.
    seed
        Seed of the order of the samples.
    validation, patience
        See :class:`Solution`; evaluated after every epoch.
    """
    solution = Solution.start(problem, validation, patience)
    every = torch.arange(len(problem.batch))
    running = torch.ones(len(every), dtype=torch.bool)
    solution.weights.requires_grad_()
    steps = -(-len(problem.data) // batch_size)
    optimiser = torch.optim.Adam([solution.weights], lr=learning_rate, foreach=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, T_max=max_iter * steps)
    shuffle = torch.Generator().manual_seed(seed)
    for iteration in range(1, max_iter + 1):
        order = torch.randperm(len(problem.data), generator=shuffle).to(problem.data.sign.device)
        for rows in torch.split(order, batch_size):
            _, solution.weights.grad = problem.evaluate(
                solution.weights.detach(), every, problem.data.rows(rows)
            )
            optimiser.step()
            schedule.step()
        solution.iterations[running] = iteration
        with torch.no_grad():
            solution.look(running)
        if not running.any():
            break
    solution.weights = solution.weights.detach()
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
    problem: Problem, weights: Tensor, loss: Tensor, gradient: Tensor, direction: Tensor, rows: Tensor
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
