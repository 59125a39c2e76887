"""The hypotheses on one window of effort: nothing, a payload or moving air, one motor, two motors.

Each gives the logarithm of its evidence, less a constant that is the same for all.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.core.kernels import kernel

LOSSES: Final = 20
"""Steps of the share that a motor may have lost."""
_PAIRED: Final = 10  # the same of each of two


class Rules(NamedTuple):
    """What decides, for the kernels; :mod:`mavhums.health.motor.thresholds` describes it.

    Times are numbers of rows.
    """

    windows: Integers
    odds: Array
    slow_odds: float
    least: Array
    held: Integers
    noise: Array
    air: Array
    rarity: Array
    air_slow: Array
    beside: Array
    error: Array
    low_gain: Array
    high_gain: Array
    rival_odds: float
    pair_odds: float
    pair_beside_one: float
    payload_odds: float
    payload_beside_motor: float
    noise_worth: float
    noise_floor: float
    noise_most: float
    falls: float
    yaw_damping: float
    yaw_damping_sd: float
    turn: float
    quiet_turn: float
    least_thrust: float
    least_upright: float
    reference: int
    gap: int
    airborne: int
    settled: int
    landed: int
    bank_grace: int
    upright: int


@kernel
def density(e: Array, noise: Array, extra: Array, mean: Array) -> float:
    """Return the logarithm of a normal density, less its constant."""
    a, b, c = noise[0, 0] + extra[0], noise[0, 1], noise[0, 2]
    d, f, g = noise[1, 1] + extra[1], noise[1, 2], noise[2, 2] + extra[2]
    x, y, z = e[0] - mean[0], e[1] - mean[1], e[2] - mean[2]
    p, q, r = d * g - f * f, c * f - b * g, b * f - c * d
    det = a * p + b * q + c * r
    quadratic = x * (p * x + q * y + r * z) + y * (q * x + (a * g - c * c) * y + (b * c - a * f) * z)
    quadratic += z * (r * x + (b * c - a * f) * y + (a * d - b * b) * z)
    return float(-0.5 * (quadratic / det + np.log(det)))


@kernel
def add(a: float, b: float) -> float:
    """Return the logarithm of a sum from the logarithms of its parts."""
    high, low = max(a, b), min(a, b)
    return float(high + np.log1p(np.exp(low - high)))


@kernel
def det(m: Array) -> float:
    """Return the determinant of a symmetric matrix, shape (3, 3)."""
    return float(
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] ** 2)
        - m[0, 1] * (m[0, 1] * m[2, 2] - m[1, 2] * m[0, 2])
        + m[0, 2] * (m[0, 1] * m[1, 2] - m[1, 1] * m[0, 2])
    )


@kernel
def of_others(w: int, e: Array, noise: Array, rules: Rules) -> float:
    """Return the log evidence of the best cause that is no motor: noise, or a payload or moving air."""
    zero, extra = np.zeros(3), np.zeros(3)
    best = density(e, noise, extra, zero)
    for kind in range(rules.rarity.size):
        for a in range(3):
            slow = rules.air_slow[a] if w > 3 else 0.0
            extra[a] = rules.air[kind, a] ** 2 + slow**2
        best = max(best, density(e, noise, extra, zero) - rules.rarity[kind])
    return best


@kernel
def of_motor(
    i: int, e: Array, asked: Array, noise: Array, columns: Array, rules: Rules, shares: Array
) -> float:
    """Return the log evidence that motor i lost a share, uniform from 0 to 1; fill its log posterior."""
    mean, extra = np.empty(3), np.empty(3)
    total = -1e300
    for j in range(LOSSES):
        loss = (j + 0.5) / LOSSES
        for a in range(3):
            mean[a] = loss * asked[i] * columns[i, a]
            # At least half of a quad's column, so that a zero of + frames is not taken for exact.
            reach = max(abs(columns[i, a]), 0.5 * np.abs(columns[:, a]).max())
            extra[a] = (rules.error[a] * loss * asked[i] * reach) ** 2 + rules.beside[a] ** 2
        shares[j] = density(e, noise, extra, mean)
        total = add(total, shares[j])
    return float(total - np.log(LOSSES))


@kernel
def is_payload(other: float, e: Array, asked: Array, noise: Array, columns: Array, rules: Rules) -> bool:
    """Return whether a payload or the air explains what is seen, and neither noise nor any motor does.

    ``other`` is the log evidence of :func:`of_others`.
    """
    zero = np.zeros(3)
    if other - density(e, noise, zero, zero) < rules.payload_odds:
        return False
    shares = np.empty(LOSSES)
    for i in range(columns.shape[0]):
        if other - of_motor(i, e, asked, noise, columns, rules, shares) < rules.payload_beside_motor:
            return False
    return True


@kernel
def quantiles(posterior: Array) -> tuple[float, float, float]:
    """Return the 2.5 % quantile, the mean and the 97.5 % quantile of the share lost."""
    weights = np.exp(posterior - posterior.max())
    weights /= weights.sum()
    mean, passed, low, high = 0.0, 0.0, -1.0, 1.0
    for j in range(LOSSES):
        mean += weights[j] * (j + 0.5) / LOSSES
        after = passed + weights[j]
        if low < 0.0 and after >= 0.025:
            low = (j + (0.025 - passed) / weights[j]) / LOSSES
        if passed < 0.975 <= after:
            high = (j + (0.975 - passed) / weights[j]) / LOSSES
        passed = after
    return low, mean, high


@kernel
def pair(
    best: float, other: float, e: Array, asked: Array, noise: Array, columns: Array, rules: Rules
) -> tuple[int, int]:
    """Return the two motors, from 1, that must both have lost thrust to explain what is seen, else zeros."""
    mean, extra = np.empty(3), np.empty(3)
    most, first, second = max(other + rules.pair_odds, best + rules.pair_beside_one), 0, 0
    for i in range(columns.shape[0]):
        for j in range(i):
            total = -1e300
            for m in range(_PAIRED):
                for n in range(_PAIRED):
                    one, two = (m + 0.5) / _PAIRED * asked[i], (n + 0.5) / _PAIRED * asked[j]
                    for a in range(3):
                        mean[a] = one * columns[i, a] + two * columns[j, a]
                        reach = max(one, two) * np.abs(columns[:, a]).max()
                        extra[a] = (rules.error[a] * reach) ** 2 + rules.beside[a] ** 2
                    total = add(total, density(e, noise, extra, mean))
            total -= np.log(float(_PAIRED**2))
            if total > most:
                most, first, second = total, j + 1, i + 1
    return first, second


@kernel
def bound_losses(e: Array, asked: Array, noise: Array, columns: Array, rules: Rules, recent: Array) -> None:
    """Keep in ``recent`` the largest share that each motor may have lost, with 97.5 % confidence."""
    a = np.empty((3, 3))
    a[:] = noise
    for n in range(3):
        a[n, n] += rules.air[0, n] ** 2
    inverse = np.linalg.inv(a)
    for i in range(columns.shape[0]):
        if asked[i] < 0.3:
            continue
        c = columns[i] * asked[i]
        information = c @ inverse @ c
        loss = (c @ inverse @ e) / information
        recent[i] = max(recent[i], loss + 1.96 / np.sqrt(information))
