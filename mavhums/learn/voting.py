"""A network's vote on each sample, compiled: the one part of a network that runs for hours on board.

Each sample is worked out alone, so that a vote does not depend on what it is given together with.
"""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import kernel

__all__ = ["ABSTAINS", "vote"]

ABSTAINS = -1


@kernel
def vote(
    values: NDArray[np.float64],
    columns: NDArray[np.int64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    weights: NDArray[np.float64],
    biases: NDArray[np.float64],
    difference: NDArray[np.float64],
    threshold: float,
) -> NDArray[np.int8]:
    """Return 1 for an emergency, 0 for none, -1 where a sample lies outside ``low`` … ``high``, shape (n,).

    Parameters
    ----------
    values
        V1…V12, shape (n, 12).
    columns
        Of the network's k inputs in ``values``.
    low, high
        What each input may be, shape (k,).
    weights, biases
        Of the h hidden neurons for inputs in their own units, shapes (h, k) and (h,).
    difference, threshold
        Weights of the first output less the second's, shape (h,), and what their sum must exceed.
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
            # tanh by the exponential, which is three times as fast; an overflow is infinity, as it should be.
            sum_ += difference[m] * (1.0 - 2.0 / (exp(2.0 * inner) + 1.0))
        votes[i] = 1 if sum_ > 0.0 else 0
    return votes
