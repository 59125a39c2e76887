"""Where a continuous function is zero: SciPy's functions for it take half a second to import."""

from __future__ import annotations

from collections.abc import Callable
from math import copysign, sqrt

_ROUNDING = 2.0**-52


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function is zero, to the last digits.

    Parameters
    ----------
    function
        Continuous; its values at both ends have different signs, or one of them is zero.
    low, high
        The ends.

    References
    ----------
    T. R. Chandrupatla (1997), Advances in Engineering Software 28:145.

    Examples
    --------
    >>> round(root_between(lambda x: x**3 - 2.0, 0.0, 1e6), 12)
    1.259921049895
    """
    a, b, share = high, low, 0.5
    at_a, at_b = function(a), function(b)
    while True:
        x = a + share * (b - a)
        at_x = function(x)
        if copysign(1.0, at_x) == copysign(1.0, at_a):
            c, at_c = a, at_a
        else:
            c, at_c, b, at_b = b, at_b, a, at_a
        a, at_a = x, at_x
        best, at_best = (a, at_a) if abs(at_a) < abs(at_b) else (b, at_b)
        least = _ROUNDING * max(abs(best), _ROUNDING * abs(high - low)) / abs(b - c) if b != c else 1.0
        if at_best == 0.0 or least > 0.5:
            return best
        xi, phi = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        share = 0.5
        if 1 - sqrt(1 - xi) < phi < sqrt(xi):  # a parabola through the inverse crosses between them
            share = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            share += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
        share = min(max(share, least), 1 - least)
