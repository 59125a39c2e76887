"""Scaling onto the unit interval, which makes results independent of units (paper, section 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["unit_interval"]


def unit_interval(
    values: NDArray[np.float64], minimum: NDArray[np.float64], maximum: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Map each feature's minimum to 0 and its maximum to 1; values beyond them are not clipped.

    Parameters
    ----------
    values
        Shape (n, k).
    minimum, maximum
        Range of each feature, shape (k,). A feature with equal minimum and maximum is shifted to 0.

    Returns
    -------
    NDArray
        Shape (n, k), dimensionless.

    Examples
    --------
    >>> import numpy as np
    >>> unit_interval(np.array([[10.0], [15.0], [20.0]]), np.array([10.0]), np.array([20.0])).ravel()
    array([0. , 0.5, 1. ])
    """
    # Half values, because the difference of two large floats of opposite sign overflows.
    span = maximum / 2 - minimum / 2
    scaled: NDArray[np.float64] = (values / 2 - minimum / 2) / np.where(span > 0, span, 0.5)
    return scaled
