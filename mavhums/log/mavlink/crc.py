"""CRC-16/MCRF4XX (X.25) of MAVLink frames, eight bytes at a time.

The CRC is linear, so it is computed with a start value of zero, for which leading zeros have no
effect: the first word is masked, and no tail is processed byte by byte. The contribution of the
real start value 0xFFFF depends only on the length and comes from a table.
Slicing: Kounavis and Berry, "A systematic approach to building high performance software-based CRC
generators" (2005).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Bytes
from mavhums.core.kernels import inlined, kernel
from mavhums.log.base.unaligned_io import load_word

__all__ = ["crc_of", "finish_crc", "seed_of"]

_POLYNOMIAL = 0x8408
_LONGEST = 10 + 255


def _slices() -> NDArray[np.uint16]:
    """Return T of shape (8, 256): T[j, b] is the CRC of byte b followed by j zero bytes."""
    table = np.zeros((8, 256), dtype=np.uint16)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc >> 1) ^ (_POLYNOMIAL if crc & 1 else 0)
        table[0, byte] = crc
    for j in range(1, 8):
        table[j] = (table[j - 1] >> 8) ^ table[0, table[j - 1] & 0xFF]
    return table


def _start_values() -> NDArray[np.uint16]:
    """Return the contribution of the start value 0xFFFF to the CRC of n bytes, for n = 0…265."""
    out = np.zeros(_LONGEST + 1, dtype=np.uint16)
    out[0] = 0xFFFF
    for n in range(_LONGEST):
        out[n + 1] = (out[n] >> 8) ^ _T[0, out[n] & 0xFF]
    return out


_T = _slices()
_T0, _T1, _T2, _T3, _T4, _T5, _T6, _T7 = _T
_START = _start_values()
_BY_HIGH_BYTE = np.argsort(_T0 >> 8).astype(np.uint16)
_BYTE = np.uint64(0xFF)
_ONES = np.uint64(0xFFFF_FFFF_FFFF_FFFF)


@inlined
def crc_of(data: Bytes, start: int, end: int) -> Any:
    """Return the CRC of ``data[start:end]``, at most 265 bytes, without crc_extra.

    Seven bytes before ``start`` must be readable.
    """
    size = end - start
    words = (size + 7) >> 3
    place = end - (words << 3)
    keep = _ONES << np.uint64((start - place) << 3)
    crc = np.uint64(0)
    for _ in range(words):
        word = (load_word(data, place) & keep) ^ crc
        keep = _ONES
        crc = np.uint64(
            _T7[word & _BYTE]
            ^ _T6[(word >> np.uint64(8)) & _BYTE]
            ^ _T5[(word >> np.uint64(16)) & _BYTE]
            ^ _T4[(word >> np.uint64(24)) & _BYTE]
            ^ _T3[(word >> np.uint64(32)) & _BYTE]
            ^ _T2[(word >> np.uint64(40)) & _BYTE]
            ^ _T1[(word >> np.uint64(48)) & _BYTE]
            ^ _T0[word >> np.uint64(56)]
        )
        place += 8
    return crc ^ np.uint64(_START[np.uint64(size)])


@inlined
def finish_crc(crc: Any, crc_extra: int) -> Any:
    """Return the final CRC, after adding the message's crc_extra."""
    return (crc >> np.uint64(8)) ^ np.uint64(_T0[(crc ^ np.uint64(crc_extra)) & _BYTE])


@kernel
def seed_of(crc: Any, received: Any) -> int:
    """Return the crc_extra that turns ``crc`` into ``received``, or -1 if none does.

    One in 256 damaged frames has one by chance.
    """
    entry = np.uint64(received) ^ (crc >> np.uint64(8))
    index = np.uint64(_BY_HIGH_BYTE[(entry >> np.uint64(8)) & _BYTE])
    if np.uint64(_T0[index]) != entry:
        return -1
    return int((index ^ crc) & _BYTE)
