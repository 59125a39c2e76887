"""Positions of the parts of a frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.core.kernels import inlined
from mavhums.log.flags import MAVLINK1, SIGNED

__all__ = [
    "HEAD_V1",
    "HEAD_V2",
    "MAGIC_V1",
    "MAGIC_V2",
    "NO",
    "SIGNATURE",
    "WAIT",
    "YES",
    "follows",
    "frame_end",
    "parts_of",
]

YES, NO, WAIT = 1, 0, -1
"""Answers; ``WAIT`` means that more bytes are needed."""

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
HEAD_V1, HEAD_V2 = 6, 10
_CRC = 2
SIGNATURE = 13


@inlined
def frame_end(data: NDArray[np.uint8], start: int) -> int:
    """Return the end of the frame at ``start``, ``NO`` if there is none, ``WAIT`` if its header is cut."""
    if start >= data.size:
        return WAIT
    if data[start] == MAGIC_V2:
        if start + HEAD_V2 > data.size:
            return WAIT
        flags = data[start + 2]
        if flags > 1:
            return NO
        return int(start + HEAD_V2 + _CRC + np.int64(data[start + 1]) + SIGNATURE * np.int64(flags))
    if data[start] == MAGIC_V1:
        if start + HEAD_V1 > data.size:
            return WAIT
        return int(start + HEAD_V1 + _CRC + np.int64(data[start + 1]))
    return NO


@inlined
def follows(data: NDArray[np.uint8], end: int, stamp: int, final: bool) -> int:
    """Return whether a magic byte, or the end of the log, follows the record that ends at ``end``."""
    if end + stamp < data.size:
        return YES if data[end + stamp] == MAGIC_V2 or data[end + stamp] == MAGIC_V1 else NO
    if final:
        return YES if end == data.size else NO
    return WAIT


@inlined
def parts_of(data: NDArray[np.uint8], start: int) -> tuple[int, int, int, int]:
    """Return message id, positions of sequence number and CRC, and flags of the frame at ``start``."""
    length = int(np.int64(data[start + 1]))
    if data[start] == MAGIC_V1:
        return int(np.int64(data[start + 5])), start + 2, start + HEAD_V1 + length, MAVLINK1
    number = np.int64(data[start + 7]) | np.int64(data[start + 8]) << 8 | np.int64(data[start + 9]) << 16
    return int(number), start + 4, start + HEAD_V2 + length, SIGNED if data[start + 2] else 0
