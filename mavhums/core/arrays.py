"""Type aliases of numpy arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers; NaN where they are not known."""

Flags = NDArray[np.bool_]
"""Masks."""

Integers = NDArray[np.int64]
"""Counts and indices."""

Bytes = NDArray[np.uint8]
"""Bytes of a log, or columns of small numbers."""

Records = NDArray[np.void]
"""Rows with fields."""
