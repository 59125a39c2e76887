"""Converts data messages in stream order to columns by layout: a counting sort and a copy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import kernel
from mavhums.log.ulog._headers import BODY
from mavhums.log.words import load_word, store_word

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
    ordinal: int,
    offset_us: int,
    wanted: NDArray[np.bool_],
    sizes: NDArray[np.int64],
    row_of: NDArray[np.int64],
    byte_of: NDArray[np.int64],
    frame: NDArray[np.int64],
    time_us: NDArray[np.int64],
    header: NDArray[np.uint8],
    records: NDArray[np.uint8],
) -> None:
    """Copy the records of wanted rows to columns.

    Parameters
    ----------
    data, base
        The buffer that was scanned, with seven bytes more at its end, and the stream offset of its
        first byte.
    ordinal, offset_us
        Number of messages before these rows, and the offset added to their times.
    wanted, sizes
        By layout: whether it is wanted, and the bytes of a record.
    row_of, byte_of
        By layout: position of its next row and record; advanced.
    frame, time_us, header, records
        Output. ``header`` has shape (2, n): multi id, and 1 where the time is odd. After each layout's
        records ``SPARE`` bytes are overwritten.
    """
    for k in range(rows.size):
        row = rows[k]
        layout = row.definition
        if layout < 0 or not wanted[layout]:
            continue
        out = row_of[layout]
        row_of[layout] = out + 1
        frame[out] = ordinal + k
        time_us[out] = row.time_us + offset_us
        header[0, out] = row.instance
        header[1, out] = row.odd
        begin = row.offset - base + BODY + 2
        place = byte_of[layout]
        size = sizes[layout]
        byte_of[layout] = place + size
        for j in range(0, size, 8):
            store_word(records, place + j, load_word(data, begin + j))
