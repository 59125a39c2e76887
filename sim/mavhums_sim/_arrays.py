"""Aliases of numpy's array types."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Records = NDArray[np.void]
"""Rows with fields."""
