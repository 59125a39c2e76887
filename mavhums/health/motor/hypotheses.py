"""The hypotheses about a multirotor: a motor that lost a share of its thrust, and the air or a payload.

The share is one of a grid. Air and payload are an effort on a grid, which stays until it changes to another
one: a hidden Markov model, whose forward filter gives the likelihood of a healthy row. All efforts are in
units of the hover thrust of one motor. Products are sums here: numpy's linear algebra in a kernel loads
scipy's, which takes a tenth of a second.
"""

from __future__ import annotations

from itertools import product
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Array1, Array2
from mavhums.core.kernels import kernel, subroutine
from mavhums.health.motor import thresholds as t

_LOSSES: Final = 10
"""Steps of the share that a motor may have lost."""


class Hypotheses(NamedTuple):
    """What may be true.

    Attributes
    ----------
    losses
        Shares of its thrust that a motor may have lost, shape (n,).
    air
        Efforts about roll, pitch and yaw that are no fault, shape (m, 3).
    air_weights
        Their probabilities where the air has just changed, shape (m,).
    """

    losses: Array1
    air: Array2
    air_weights: Array1


def hypotheses_of(motors: int) -> Hypotheses:
    """Return the hypotheses about a number of motors."""
    least = t.LEAST_LOSS_MORE if motors > 4 else t.LEAST_LOSS_QUAD
    levels = [sorted({sign * level for level in axis for sign in (-1.0, 1.0)}) for axis in t.AIR_LEVELS]
    air = np.array(
        [*product(*levels), *((0.0, 0.0, sign * yaw) for yaw in t.AIR_YAWS for sign in (-1.0, 1.0))]
    )
    kinds = np.exp(-0.5 * ((air[:, None] / t.AIR) ** 2).sum(axis=2))
    changed = kinds / kinds.sum(axis=0) @ (1.0 / t.AIR_RARITY) / (1.0 / t.AIR_RARITY).sum()
    still = t.STILL * (air == 0.0).all(axis=1)
    return Hypotheses(np.linspace(least, 1.0, _LOSSES), air, still + (1.0 - t.STILL) * changed)


@subroutine
def inverse(matrix: Array) -> Array:
    """Return the inverse of a 3×3 matrix, by its cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    determinant: float = (matrix[0] * out[:, 0]).sum()
    return out / determinant


@kernel
def of_health(e: Array1, precision: Array2, change: float, h: Hypotheses, air: Array1) -> float:
    """Return the logarithm of the likelihood of an effort in health, against no effort at all.

    ``air`` holds the probabilities of the efforts of the air, shape (m,), and takes this one in;
    ``change`` is the probability that the air changes.
    """
    p, total, toward = precision, 0.0, (precision * e).sum(axis=1)
    for n in range(air.size):
        x, y, z = h.air[n, 0], h.air[n, 1], h.air[n, 2]
        squares = p[0, 0] * x * x + p[1, 1] * y * y + p[2, 2] * z * z
        cross = p[0, 1] * x * y + p[0, 2] * x * z + p[1, 2] * y * z
        ratio = x * toward[0] + y * toward[1] + z * toward[2] - 0.5 * squares - cross
        # An effort beyond all levels may overflow.
        air[n] = ((1.0 - change) * air[n] + change * h.air_weights[n]) * np.exp(min(ratio, 600.0))
        total += air[n]
    air /= total
    return float(np.log(total))


@kernel
def of_losses(
    e: Array1, asked: Array1, precision: Array2, columns: Array2, h: Hypotheses, ratios: Array2
) -> None:
    """Fill the logarithms of the likelihoods of an effort by each loss of each motor, against no effort."""
    toward = (precision * e).sum(axis=1)
    for i in range(columns.shape[0]):
        c = columns[i] * asked[i]
        along, squares = (c * toward).sum(), (c * (precision * c).sum(axis=1)).sum()
        for k in range(h.losses.size):
            ratios[i, k] = h.losses[k] * along - 0.5 * h.losses[k] ** 2 * squares


@kernel
def regression(e: Array1, asked: float, noise: Array2, column: Array1) -> tuple[float, float]:
    """Return the share that a motor lost, by the effort along its column, and its standard deviation."""
    toward = (inverse(noise) * (column * asked)).sum(axis=1)
    information = (toward * column).sum() * asked
    return float((toward * e).sum() / information), float(1.0 / np.sqrt(information))
