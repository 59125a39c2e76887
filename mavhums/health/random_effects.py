"""Random-effects least squares, for flights that differ by more than their measurement errors.

References
----------
R. C. Paule and J. Mandel (1982), Journal of Research of the National Bureau of Standards 87:377.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["variance_between", "weighted"]

Array = NDArray[np.float64]


def weighted(design: Array, values: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Return the coefficients, the weighted residuals and the inverse of the normal matrix.

    Parameters
    ----------
    design, values, weights
        Shapes (n, p), (n,) and (n,); weights are inverse variances.
    """
    root = np.sqrt(weights)
    scaled = design * root[:, None]
    inverse = np.linalg.inv(scaled.T @ scaled).astype(np.float64)
    coefficients = np.linalg.lstsq(scaled, values * root)[0].astype(np.float64)
    return coefficients, root * (values - design @ coefficients), inverse


def variance_between(design: Array, values: Array, errors: Array) -> float:
    """Return the variance between flights that makes the weighted squares what they are expected to be.

    Examples
    --------
    >>> values = np.array([0.20, 0.23, 0.26])
    >>> variance = variance_between(np.ones((3, 1)), values, np.full(3, 0.01))
    >>> round(variance, 6) == round(float(np.var(values, ddof=1)) - 0.01**2, 6)
    True
    """
    from scipy.optimize import brentq  # a quarter of a second, which only flights before are worth

    freedom = len(values) - design.shape[1]

    def excess(variance: float) -> float:
        residuals = weighted(design, values, 1 / (errors**2 + variance))[1]
        return float(residuals @ residuals - freedom)

    if excess(0.0) <= 0:
        return 0.0
    plain = weighted(design, values, np.ones_like(values))[1]
    enough = 2 * float(plain @ plain) / freedom
    return float(brentq(excess, 0.0, enough, xtol=1e-9 * enough, rtol=1e-6))
