"""Converts rows in log order to columns by definition: a counting sort and a copy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import kernel
from mavhums.log.dataflash._layout import HEAD
from mavhums.log.words import GUARD, load_word, store_word

__all__ = ["SPARE", "count", "gather"]

SPARE = 8


@kernel
def count(rows: NDArray[np.void], definitions: int) -> NDArray[np.int64]:
    """Return the number of rows of each definition, shape (definitions,)."""
    counts = np.zeros(definitions, dtype=np.int64)
    for k in range(rows.size):
        counts[rows[k].definition] += 1
    return counts


@kernel
def gather(
    data: NDArray[np.uint8],
    base: int,
    rows: NDArray[np.void],
    ordinal: int,
    first_us: int,
    shift_us: int,
    sizes: NDArray[np.int64],
    known: NDArray[np.bool_],
    row_of: NDArray[np.int64],
    byte_of: NDArray[np.int64],
    frame: NDArray[np.int64],
    time_us: NDArray[np.int64],
    flags: NDArray[np.uint8],
    payloads: NDArray[np.uint8],
) -> int:
    """Copy the wanted rows to columns.

    Parameters
    ----------
    data, base
        The buffer that was scanned, and the stream offset of its first byte after the guard.
    ordinal
        Number of records before these.
    first_us, shift_us
        The time of records before the first time, and the offset added to every time.
    sizes, known
        By definition: bytes of a payload, 0 if it is not wanted; and whether its records count.
    row_of, byte_of
        By definition: position of its next row and payload; advanced.
    frame, time_us, flags, payloads
        Output. ``SPARE`` bytes after each definition's payloads are overwritten.

    Returns
    -------
    Number of records including these.
    """
    for k in range(rows.size):
        row = rows[k]
        definition = row.definition
        size = sizes[definition]
        if size > 0:
            out = row_of[definition]
            row_of[definition] = out + 1
            frame[out] = ordinal
            time_us[out] = (row.time_us if row.time_us >= 0 else first_us) + shift_us
            flags[out] = row.flags
            source = row.offset - base + GUARD + HEAD
            place = byte_of[definition]
            byte_of[definition] = place + size
            for j in range(0, size, 8):
                store_word(payloads, place + j, load_word(data, source + j))
        if known[definition]:
            ordinal += 1
    return ordinal
