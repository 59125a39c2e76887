"""Compiled kernel for a network's vote on each sample, the only part that runs continuously on board.

Each sample is computed separately, so a vote does not depend on the other samples of the call.
"""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Integers
from mavhums.core.kernels import kernel

__all__ = ["ABSTAINS", "vote"]

ABSTAINS = -1


@kernel
def vote(
    values: Array,
    columns: Integers,
    low: Array,
    high: Array,
    weights: Array,
    biases: Array,
    difference: Array,
    threshold: float,
) -> NDArray[np.int8]:
    """Return 1 for an emergency, 0 for none, -1 for a sample outside ``low`` … ``high``, shape (n,).

    Parameters
    ----------
    values
        V1…V12, shape (n, 12).
    columns
        Columns of the network's k inputs in ``values``.
    low, high
        Bounds of each input, shape (k,).
    weights, biases
        Weights and biases of the h hidden neurons for unscaled inputs, shapes (h, k) and (h,).
    difference, threshold
        Output weights, first minus second, shape (h,), and the threshold for their sum.
    """
    n, k, h = len(values), len(columns), len(biases)
    votes = np.empty(n, dtype=np.int8)
    inputs = np.empty(k)
    for i in range(n):
        inside = True
        for j in range(k):
            x = values[i, columns[j]]
            if not low[j] <= x <= high[j]:
                inside = False
                break
            inputs[j] = x
        if not inside:
            votes[i] = ABSTAINS
            continue
        sum_ = -threshold
        for m in range(h):
            inner = biases[m]
            for j in range(k):
                inner += weights[m, j] * inputs[j]
            # tanh by the exponential is three times as fast; overflow gives infinity, which is correct here.
            sum_ += difference[m] * (1.0 - 2.0 / (exp(2.0 * inner) + 1.0))
        votes[i] = 1 if sum_ > 0.0 else 0
    return votes
