"""Many small tanh networks computed as one tensor program; imported only for training.

The networks share the samples. They differ in their weights, numbers of hidden neurons and input
features; masks remove the neurons and features that a network does not have. Its outputs are
V·tanh(W x + b) + c, one for each class. With two classes the decision depends only on the difference of
the outputs, and weight decay makes their optimal weights opposite. Training therefore fits one output, the
difference: w2 = (v/2, -v/2), b2 = (c/2, -c/2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mavhums.core.arrays import Array, Flags
from mavhums.learn.inference import TanhNetwork

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
