"""Constants and distributions of statistics and physics that more than one room needs, each once."""

from __future__ import annotations

from collections.abc import Callable
from math import erfc, exp, lgamma, log, log1p, pi, sqrt
from typing import Final, TypeVar, overload

import numpy as np

from mavhums.core.arrays import Array, Array1
from mavhums.core.kernels import kernel, subroutine

NORMAL_95: Final = 1.96
"""Half the width of a normal distribution's central 95 % interval, in standard deviations."""

ERRORS_95: Final = 2.0
"""The same, rounded, of estimates with errors that are estimates themselves."""

NORMAL_95_ONE_SIDED: Final = 1.645
"""What a standard normal variable exceeds with 5 % probability."""

CENTRAL_95: Final = 0.975
"""Probability below the upper end of a central 95 % interval, for quantiles of Student's t."""

TAIL_95: Final = 0.025
"""Probability beyond either end of a central 95 % interval."""

RAD_S_PER_REV_MIN: Final = pi / 30
"""Speed of one revolution per minute, rad/s."""

DEGREES_S_PER_REV_MIN: Final = 6.0
"""Speed of one revolution per minute, °/s."""

STANDARD_GRAVITY: Final = 9.80665
"""Standard acceleration of free fall, m/s²; load factors and sensors' milli-g are multiples of it."""

AIR_DENSITY: Final = 1.225
"""Density of the standard atmosphere at sea level, kg/m³."""


Width = TypeVar("Width", float, Array)


def uniform_deviation(width: Width) -> Width:
    """Return the standard deviation of a value that lies anywhere in an interval of this width.

    Examples
    --------
    >>> round(uniform_deviation(1.0), 4)
    0.2887
    """
    return width / sqrt(12.0)


@overload
def t_quantile(freedom: float, probability: float) -> float: ...
@overload
def t_quantile(freedom: Array, probability: float | Array) -> Array: ...
def t_quantile(freedom: float | Array, probability: float | Array) -> float | Array:
    """Return what Student's t with these degrees of freedom does not exceed with this probability.

    Examples
    --------
    >>> round(t_quantile(9, CENTRAL_95), 3)
    2.262
    """
    return _each(_quantiles, freedom, probability)


@overload
def t_probability(freedom: float, value: float) -> float: ...
@overload
def t_probability(freedom: float, value: Array) -> Array: ...
@overload
def t_probability(freedom: Array, value: float | Array) -> Array: ...
def t_probability(freedom: float | Array, value: float | Array) -> float | Array:
    """Return the probability that Student's t with these degrees of freedom lies below a value.

    Examples
    --------
    >>> t_probability(9, 0.0)
    0.5
    """
    return _each(_probabilities, freedom, value)


def _each(
    values_of: Callable[[Array, Array], Array], freedom: float | Array, at: float | Array
) -> float | Array:
    """Return a kernel's values of numbers and arrays of any shapes that fit each other."""
    wide = np.broadcast_arrays(*(np.asarray(given, dtype=np.float64) for given in (freedom, at)))
    # Copies: a kernel that is compiled at its first call asks whether it may write to them, and numpy warns.
    found = values_of(*(each.flatten() for each in wide)).reshape(wide[0].shape)
    return found if found.ndim else float(found)


# Student's t is our own, for to import scipy's takes longer than to judge a log.
@kernel
def _probabilities(freedom: Array1, values: Array1) -> Array:
    """Return the probabilities below values."""
    out = np.empty(len(values))
    for k in range(len(values)):
        tail = exp(_tail(freedom[k], abs(values[k])))
        out[k] = tail if values[k] < 0.0 else 1.0 - tail
    return out


@kernel
def _quantiles(freedom: Array1, probabilities: Array1) -> Array:
    """Return the quantiles, by Newton's method: over the logarithm of t that of the tail is concave."""
    out = np.empty(len(freedom))
    for k in range(len(freedom)):
        if k and freedom[k] == freedom[k - 1] and probabilities[k] == probabilities[k - 1]:
            out[k] = out[k - 1]
            continue
        wanted = min(probabilities[k], 1.0 - probabilities[k])
        if not (wanted > 0.0 and freedom[k] > 0.0):
            certain = wanted == 0.0 and freedom[k] > 0.0
            out[k] = np.copysign(np.inf, probabilities[k] - 0.5) if certain else np.nan
            continue
        # The start is the normal distribution's (Abramowitz and Stegun, 26.2.23).
        w = sqrt(-2.0 * log(wanted))
        t = w - (2.515517 + w * (0.802853 + w * 0.010328)) / (
            1.0 + w * (1.432788 + w * (0.189269 + w * 0.001308))
        )
        t, step = max(t, 1e-3), 1.0
        for _ in range(100):
            if abs(step) < 1e-13 or wanted == 0.5:
                break
            tail = _tail(freedom[k], t)
            step = (tail - log(wanted)) / (t * exp(_density(freedom[k], t) - tail))
            t *= exp(min(step, 50.0))
        out[k] = np.copysign(t if wanted < 0.5 else 0.0, probabilities[k] - 0.5)
    return out


@subroutine
def _density(freedom: float, t: float) -> float:
    """Return the logarithm of the density, from that of Γ(a + 1/2)/Γ(a)."""
    a = min(0.5 * freedom, 1e12)
    ratio = lgamma(a + 0.5) - lgamma(a) if a < 1e4 else 0.5 * log(a) - 0.125 / a + 1.0 / (192.0 * a**3)
    return ratio - 0.5 * log(2.0 * a * pi) - (a + 0.5) * log1p(t * t / (2.0 * a))


@subroutine
def _tail(freedom: float, t: float) -> float:
    """Return the logarithm of the probability above t ≥ 0, an incomplete beta function, by Lentz's method."""
    if not freedom > 0.0 or not np.isfinite(t):
        return -np.inf if freedom > 0.0 and t > 0.0 else np.nan
    if freedom > 1e6:  # where Wallace's normal approximation is as exact
        many = min(freedom, 1e12)
        z = sqrt(many * log1p(t * t / many)) * (8.0 * many + 1.0) / (8.0 * many + 3.0)
        return log(0.5 * erfc(z / sqrt(2.0)) + 1e-320)
    a, b, x = 0.5 * freedom, 0.5, freedom / (freedom + t * t)
    swapped = x > (a + 1.0) / (a + b + 2.0)
    if swapped:
        a, b, x = b, a, t * t / (freedom + t * t)
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, 10_000):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        for term in (even, odd):
            d, c = 1.0 / (1.0 + term * d), 1.0 + term / c
            value *= d * c
        if abs(d * c - 1.0) < 1e-15:
            break
    if swapped:
        return log(0.5 - t * exp(_density(freedom, t)) * value)
    return _density(freedom, t) + log(t * value / freedom)
