"""Test of whether flights follow a straight line, which may be extrapolated, or another course."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

__all__ = ["departure"]

_SURE = 0.995
_SURE_Z = 2.58
_LIKELIER = 20.0
_LEAST = 2

Array = NDArray[np.float64]


def departure(numbers: Array, values: Array, weights: Array) -> str | None:
    """Describe how flights depart from their weighted least-squares line; None if they do not.

    They depart from it if one step between two levels is twenty times as likely as the line, if a square
    term is significant at 1 %, or if the lag-one autocorrelation of the residuals is significant at 0.5 %.

    Parameters
    ----------
    numbers, values, weights
        Numbers, values and weights of the flights in time order, shape (n,), n ≥ 4; weights are inverse
        variances.

    Examples
    --------
    >>> flights = np.arange(20.0)
    >>> departure(flights, 0.2 + 0.01 * flights + 0.003 * np.cos(2.4 * flights), np.ones(20))
    >>> departure(flights, 0.2 + 0.1 * (flights > 11) + 0.003 * np.cos(2.4 * flights), np.ones(20))
    'it changed in one step'
    """
    root = np.sqrt(weights)
    at = (numbers - numbers.mean()) / np.ptp(numbers)
    line = _residuals(at, values, root, 1)
    squares = float(line @ line)
    if _best_step(values, weights) < squares * _LIKELIER ** (-2 / len(values)):
        return "it changed in one step"
    curve = _residuals(at, values, root, 2)
    freedom = len(values) - 3
    gain = squares - float(curve @ curve)
    if gain * freedom > stdtrit(freedom, _SURE) ** 2 * float(curve @ curve):
        return "it grows ever faster or slower"
    if float(line[:-1] @ line[1:]) * sqrt(len(line)) > _SURE_Z * squares:
        return "it comes and goes, as with a season"
    return None


def _residuals(at: Array, values: Array, root: Array, degree: int) -> Array:
    design = np.vander(at, degree + 1) * root[:, None]
    coefficients = np.linalg.lstsq(design, values * root)[0]
    residuals: Array = values * root - design @ coefficients
    return residuals


def _best_step(values: Array, weights: Array) -> float:
    """Return the smallest weighted sum of squares about two levels, each of at least two flights."""
    values = values - values.mean()
    first = slice(_LEAST - 1, len(values) - _LEAST)
    before, moment = np.cumsum(weights), np.cumsum(weights * values)
    explained = moment[first] ** 2 / before[first]
    explained += (moment[-1] - moment[first]) ** 2 / (before[-1] - before[first])
    return float(weights @ values**2 - explained.max())
