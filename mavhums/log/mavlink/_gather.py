"""Converts rows in stream order to columns per message: a counting sort and a copy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import inlined, kernel
from mavhums.log.flags import MAVLINK1
from mavhums.log.words import GUARD, load_word, store_word

__all__ = ["SPARE", "count", "gather"]

SPARE = 8


@kernel
def count(rows: NDArray[np.void], wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the number of rows of each wanted message, same shape as ``wanted``."""
    counts = np.zeros(wanted.size, dtype=np.int64)
    for k in range(rows.size):
        message = rows[k].message
        if message >= 0 and wanted[message]:
            counts[message] += 1
    return counts


@inlined
def _copy(
    data: NDArray[np.uint8], source: int, kept: int, out: NDArray[np.uint8], place: int, size: int
) -> None:
    """Copy ``kept`` bytes and fill up to ``size`` with zeros; ``out`` has a word to spare behind it.

    Whole words are written; bytes beyond the end belong to the next record, which is written later.
    """
    for j in range(0, size, 8):
        left = kept - j
        if left >= 8:
            store_word(out, place + j, load_word(data, source + j))
        elif left > 0:
            word = load_word(data, source + kept - 8) >> np.uint64(64 - 8 * left)
            store_word(out, place + j, word)
        else:
            store_word(out, place + j, np.uint64(0))


@kernel
def gather(
    data: NDArray[np.uint8],
    base: int,
    stamp: int,
    rows: NDArray[np.void],
    ordinal: int,
    wanted: NDArray[np.bool_],
    sizes: NDArray[np.int32],
    row_of: NDArray[np.int64],
    byte_of: NDArray[np.int64],
    frame: NDArray[np.int64],
    time_us: NDArray[np.int64],
    header: NDArray[np.uint8],
    payloads: NDArray[np.uint8],
) -> int:
    """Copy the wanted rows to columns, and restore the zeros that senders trim.

    Parameters
    ----------
    data, base, stamp
        The scanned buffer, the stream offset of its first byte after the guard, and the number of
        time stamp bytes before each frame.
    ordinal
        Number of known frames before this batch.
    wanted, sizes
        By message: whether it is wanted, and its record size in bytes.
    row_of, byte_of
        By message: position of its next row and payload; advanced.
    frame, time_us, header, payloads
        Output. ``header`` has shape (4, n): system, component, sequence, flags. ``SPARE`` bytes
        after each message's payloads are overwritten.

    Returns
    -------
    Number of known frames including this batch.
    """
    for k in range(rows.size):
        row = rows[k]
        message = row.message
        if message < 0:
            continue
        if wanted[message]:
            out = row_of[message]
            row_of[message] = out + 1
            frame[out] = ordinal
            time_us[out] = row.time_us
            header[0, out] = row.system
            header[1, out] = row.component
            header[2, out] = row.sequence
            header[3, out] = row.flags
            source = row.offset - base + GUARD + stamp + (6 if row.flags & MAVLINK1 else 10)
            size = int(sizes[message])
            kept = min(int(row.length), size)
            place = byte_of[message]
            byte_of[message] = place + size
            _copy(data, source, kept, payloads, place, size)
        ordinal += 1
    return ordinal
