"""Aliases of numpy's array types."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Bytes", "Flags", "Indices", "Integers", "Records"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]
Indices = NDArray[np.intp]
Bytes = NDArray[np.uint8]
Records = NDArray[np.void]
"""Rows with fields."""
