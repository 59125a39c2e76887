"""Constants and distributions of statistics and physics that more than one room needs, each once."""

from __future__ import annotations

from math import pi, sqrt
from typing import Final, TypeVar, cast, overload

from mavhums.core.arrays import Array

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


# Both import SciPy when they are called: a log without a decision needs neither, and waits 0.2 s less.
@overload
def t_quantile(freedom: float, probability: float) -> float: ...
@overload
def t_quantile(freedom: Array, probability: float | Array) -> Array: ...
def t_quantile(freedom: float | Array, probability: float | Array) -> float | Array:
    """Return what Student's t with these degrees of freedom does not exceed with this probability.

    Examples
    --------
    >>> float(round(t_quantile(9, CENTRAL_95), 3))
    2.262
    """
    from scipy.special import stdtrit

    return cast(Array, stdtrit(freedom, probability))


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
    >>> float(t_probability(9, 0.0))
    0.5
    """
    from scipy.special import stdtr

    return cast(Array, stdtr(freedom, value))
