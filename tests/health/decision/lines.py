"""A flight beside the line of the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def beside_the_line(numbers: Array, values: Array, place: int, chance: float) -> float:
    """Return a value above the line of the others that chance exceeds, to either side, so often."""
    others = np.delete(np.arange(len(numbers)), place)
    design = np.column_stack([np.ones_like(numbers), numbers])
    line, squares, _, _ = np.linalg.lstsq(design[others], values[others])
    apart = design[place] @ np.linalg.inv(design[others].T @ design[others]) @ design[place]
    freedom = len(others) - 2
    deviation = np.sqrt(squares[0] / freedom * (1.0 + apart))
    return float(design[place] @ line + deviation * stats.t.ppf(1.0 - chance / 2, freedom))
