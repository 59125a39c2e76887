"""From rows in the order of the stream to columns by message: a counting sort and a copy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.log._crc import GUARD
from mavhums.log._jit import kernel
from mavhums.log.flags import MAVLINK1

__all__ = ["count", "gather"]


@kernel
def count(rows: NDArray[np.void], wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the number of rows of each wanted message, shape as ``wanted``."""
    counts = np.zeros(wanted.size, dtype=np.int64)
    for k in range(rows.size):
        message = rows[k].message
        if message >= 0 and wanted[message]:
            counts[message] += 1
    return counts


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
    """Copy the wanted rows to columns; the zeros that senders trim are put back.

    Parameters
    ----------
    data, base, stamp
        The buffer that was scanned, the stream offset of its first byte after the guard, and the
        bytes of time stamp before each frame.
    ordinal
        Number of known frames before this batch.
    wanted, sizes
        By message: whether it is wanted, and its record size in bytes.
    row_of, byte_of
        By message: where its next row and payload go; advanced.
    frame, time_us, header, payloads
        Written. ``header`` has shape (4, n): system, component, sequence, flags.

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
            size = np.int64(sizes[message])
            kept = min(np.int64(row.length), size)
            place = byte_of[message]
            byte_of[message] = place + size
            for j in range(kept):
                payloads[place + j] = data[source + j]
            for j in range(kept, size):
                payloads[place + j] = 0
        ordinal += 1
    return ordinal
