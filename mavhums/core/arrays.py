"""Type aliases of numpy arrays; those with a number of axes are what a compiled kernel takes."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray


class Block(NamedTuple):
    """A C-contiguous array as a kernel takes it: the metadata of an annotation."""

    dtype: DTypeLike
    ndim: int = 1


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

Array1 = Annotated[Array, Block(np.float64)]
Array2 = Annotated[Array, Block(np.float64, 2)]
Array3 = Annotated[Array, Block(np.float64, 3)]
Flags1 = Annotated[Flags, Block(np.bool_)]
Flags2 = Annotated[Flags, Block(np.bool_, 2)]
Integers1 = Annotated[Integers, Block(np.int64)]
Integers2 = Annotated[Integers, Block(np.int64, 2)]
Integers3 = Annotated[Integers, Block(np.int64, 3)]
Bytes1 = Annotated[Bytes, Block(np.uint8)]
Bytes2 = Annotated[Bytes, Block(np.uint8, 2)]
