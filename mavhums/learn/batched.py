"""Many small tanh networks computed as one tensor program; imported only for training.

The networks share the samples. They differ in their weights, numbers of hidden neurons and input
features; masks remove the neurons and features that a network does not have. A network's decision
depends only on the difference of its two outputs, and weight decay makes their optimal weights
opposite. Training therefore fits the difference: d = v·tanh(W x + b) + c, w2 = (v/2, -v/2),
b2 = (c/2, -c/2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from mavhums.learn.inference import TanhNetwork

__all__ = ["Batch", "Data", "Problem"]

_BLOCK = 1 << 19
"""Number of hidden activations computed at once; they fit into the processor's cache."""

Tensor = torch.Tensor


@dataclass(frozen=True, eq=False)
class Data:
    """Samples in the form that the tensor program uses.

    Attributes
    ----------
    features
        Features on the unit interval and a column of ones for the bias, shape (n, k + 1).
    sign
        1 for an emergency, -1 otherwise, shape (n,).
    weight
        Weight of each sample, shape (n,); the sum is 1.
    """

    features: Tensor
    sign: Tensor
    weight: Tensor

    @classmethod
    def of(
        cls,
        scaled: NDArray[np.float64],
        emergency: NDArray[np.bool_],
        weight: NDArray[np.float64] | None = None,
        *,
        device: str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> Data:
        """Convert scaled features of shape (n, k), and classes and weights of shape (n,)."""
        weight = np.ones(len(scaled)) if weight is None else weight
        columns = np.column_stack([scaled, np.ones(len(scaled))])
        parts = (columns, np.where(emergency, 1.0, -1.0), weight / weight.sum())
        return cls(*(torch.tensor(part, dtype=dtype, device=device) for part in parts))

    def __len__(self) -> int:
        return len(self.sign)

    def rows(self, rows: Tensor | slice) -> Data:
        """Return a subset of the samples, with their weights normalised to sum 1."""
        weight = self.weight[rows]
        return Data(self.features[rows], self.sign[rows], weight / weight.sum())


@dataclass(frozen=True, eq=False)
class Batch:
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
    subsets: NDArray[np.bool_]
    seeds: Sequence[int]

    def __len__(self) -> int:
        return len(self.hidden)

    def part(self, networks: Sequence[int]) -> Batch:
        """Return a subset of the networks."""
        hidden, seeds = ([values[i] for i in networks] for values in (self.hidden, self.seeds))
        return Batch(hidden, self.subsets[list(networks)], seeds)


class Problem:
    """Loss and gradient of every network of a batch, as functions of the matrix of weights.

    Row i of the matrix, of shape (B, h·(k + 1) + h + 1), holds W with its bias column, v and c of
    network i; h is the largest number of hidden neurons.

    Parameters
    ----------
    batch
        The networks.
    data
        The training samples.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean loss.
    """

    def __init__(self, batch: Batch, data: Data, weight_decay: float) -> None:
        self.batch, self.data = batch, data
        self.width, self.inputs = max(batch.hidden), batch.subsets.shape[1]
        neurons = torch.arange(self.width)[None, :] < torch.tensor(list(batch.hidden))[:, None]
        seen = torch.tensor(np.column_stack([batch.subsets, np.ones(len(batch), dtype=bool)]))
        masks = [(neurons[:, :, None] & seen[:, None, :]).flatten(1), neurons, torch.ones(len(batch), 1)]
        self.mask = torch.cat([part.to(data.features) for part in masks], dim=1)
        penalty = torch.full((self.width, self.inputs + 1), float(weight_decay))
        penalty[:, -1] = 0
        halved = torch.full((self.width,), weight_decay / 2)
        self.penalty = torch.cat([penalty.flatten(), halved, torch.zeros(1)]).to(data.features)

    def initial(self) -> Tensor:
        """Draw Glorot's uniform weights; each network uses its own seed, independent of the batch."""
        weights = torch.zeros_like(self.mask)
        for row, (hidden, seed) in enumerate(zip(self.batch.hidden, self.batch.seeds, strict=True)):
            draw = torch.Generator().manual_seed(int(seed))
            seen = np.flatnonzero(np.append(self.batch.subsets[row], True))
            first = (torch.rand(hidden, len(seen), generator=draw) * 2 - 1) * (
                6 / (len(seen) + hidden)
            ) ** 0.5
            last = torch.rand(2, hidden + 1, generator=draw).diff(dim=0)[0] * 2 * (6 / (hidden + 2)) ** 0.5
            matrix = torch.zeros(self.width, self.inputs + 1)
            matrix[:hidden, seen] = first
            weights[row, : matrix.numel()] = matrix.flatten()
            weights[row, matrix.numel() : matrix.numel() + hidden] = last[:-1]
            weights[row, -1] = last[-1]
        return weights

    def evaluate(self, weights: Tensor, networks: Tensor, data: Data | None = None) -> tuple[Tensor, Tensor]:
        """Return loss, shape (R,), and gradient, the shape of ``weights``, of some networks.

        Parameters
        ----------
        weights
            Rows of the networks, shape (R, …).
        networks
            Indices of these networks in the batch, shape (R,).
        data
            Samples that replace those of the problem, such as a mini-batch.
        """
        data = data or self.data
        w1, v, c = self._split(weights)
        loss = (weights.square() @ self.penalty) / 2
        gradient = weights * self.penalty
        g1, gv, gc = self._split(gradient)
        for rows in self._blocks(len(weights), len(data)):
            features, sign, share = data.features[rows], data.sign[rows], data.weight[rows]
            hidden = self._hidden(w1, features)
            margin = (torch.bmm(v[:, None], hidden)[:, 0] + c) * sign
            loss += torch.nn.functional.softplus(-margin) @ share
            delta = torch.sigmoid(-margin).mul_(-sign * share)
            gv += torch.bmm(hidden, delta[:, :, None])[:, :, 0]
            gc += delta.sum(dim=1, keepdim=True)
            inner = hidden.square_().neg_().add_(1).mul_(delta[:, None]).mul_(v[:, :, None])
            g1 += (inner.flatten(0, 1) @ features).view_as(g1)
        return loss, gradient.mul_(self.mask[networks])

    def logits(self, weights: Tensor, data: Data) -> Tensor:
        """Return the difference of the outputs of each network, shape (B, n)."""
        w1, v, c = self._split(weights)
        parts = [
            torch.bmm(v[:, None], self._hidden(w1, data.features[rows]))[:, 0] + c
            for rows in self._blocks(len(weights), len(data))
        ]
        return torch.cat(parts, dim=1)

    def loss(self, weights: Tensor, data: Data) -> Tensor:
        """Return the mean cross-entropy of each network, without decay, shape (B,)."""
        return torch.nn.functional.softplus(-self.logits(weights, data) * data.sign) @ data.weight

    def networks(
        self, weights: Tensor, minimum: NDArray[np.float64], maximum: NDArray[np.float64]
    ) -> list[TanhNetwork]:
        """Return each network as a numpy-only network with all k features as inputs."""
        w1, v, c = (part.cpu().numpy().astype(np.float64) for part in self._split(weights))
        return [
            TanhNetwork(
                minimum=minimum,
                maximum=maximum,
                w1=w1[row, :hidden, :-1].T,
                b1=w1[row, :hidden, -1],
                w2=np.column_stack([v[row, :hidden], -v[row, :hidden]]) / 2,
                b2=np.array([c[row, 0], -c[row, 0]]) / 2,
            )
            for row, hidden in enumerate(self.batch.hidden)
        ]

    def _split(self, weights: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        first = self.width * (self.inputs + 1)
        matrix = weights[:, :first].view(len(weights), self.width, self.inputs + 1)
        return matrix, weights[:, first:-1], weights[:, -1:]

    def _hidden(self, w1: Tensor, features: Tensor) -> Tensor:
        return (w1.flatten(0, 1) @ features.T).tanh_().view(len(w1), self.width, len(features))

    def _blocks(self, networks: int, samples: int) -> list[slice]:
        size = max(64, _BLOCK // (networks * self.width))
        return [slice(start, start + size) for start in range(0, samples, size)]
