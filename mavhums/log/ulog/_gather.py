"""From data messages in the order of the stream to columns by layout: a counting sort and a copy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.jit import kernel
from mavhums.log._crc import load_word, store_word
from mavhums.log.ulog._headers import BODY

__all__ = ["SPARE", "count", "gather"]

SPARE = 8


@kernel
def count(rows: NDArray[np.void], counts: NDArray[np.int64]) -> None:
    """Add the number of rows to ``counts``, shape (layouts, 256), by layout and multi id."""
    for k in range(rows.size):
        if rows[k].definition >= 0:
            counts[rows[k].definition, rows[k].instance] += 1


@kernel
def gather(
    data: NDArray[np.uint8],
    base: int,
    rows: NDArray[np.void],
    wanted: NDArray[np.bool_],
    sizes: NDArray[np.int64],
    row_of: NDArray[np.int64],
    byte_of: NDArray[np.int64],
    source: NDArray[np.int64],
    records: NDArray[np.uint8],
) -> None:
    """Copy the records of wanted rows to columns.

    Parameters
    ----------
    data, base
        The buffer that was scanned, with seven bytes more at its end, and the stream offset of its
        first byte.
    wanted, sizes
        By layout: whether it is wanted, and the bytes of a record.
    row_of, byte_of
        By layout: where its next row and record go; advanced.
    source, records
        Written: the row that each came from, and the records. Behind each layout's records ``SPARE``
        bytes are overwritten.
    """
    for k in range(rows.size):
        row = rows[k]
        layout = row.definition
        if layout < 0 or not wanted[layout]:
            continue
        source[row_of[layout]] = k
        row_of[layout] += 1
        begin = row.offset - base + BODY + 2
        place = byte_of[layout]
        size = sizes[layout]
        byte_of[layout] = place + size
        for j in range(0, size, 8):
            store_word(records, place + j, load_word(data, begin + j))
