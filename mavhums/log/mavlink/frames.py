"""Parts of a MAVLink frame, plausibility of its record's time stamp, and its CRC-16/MCRF4XX (X.25).

A time more than a minute from the last one is compared with the next record's: if the path over it
is a detour of more than two minutes, the time stamp is damaged; otherwise the clock was set or the
link was silent. If no record follows, a step of up to a day is accepted.

The CRC is computed eight bytes at a time. It is linear, so it starts with zero, for which leading zeros have
no effect: the first word is masked, and no tail is processed byte by byte. The contribution of the
real start value 0xFFFF depends only on the length and comes from a table.
Slicing: Kounavis and Berry, "A systematic approach to building high performance software-based CRC
generators" (2005).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Bytes
from mavhums.core.kernels import inlined, load_word, subroutine
from mavhums.log.base.decoder import MAVLINK1, SIGNED
from mavhums.log.base.scanner import NO, WAIT, YES, plausible

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
HEAD_V1, HEAD_V2 = 6, 10
_CRC = 2
SIGNATURE = 13

STAMP = 8
"""Size of a time stamp, bytes."""

DAY_US = 86_400 * 1_000_000
_STEP_US = 60 * 1_000_000
_YEAR_2000_US = 946_684_800_000_000


@inlined
def frame_end(data: Bytes, start: int) -> int:
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
def follows(data: Bytes, end: int, stamp: int, final: bool) -> int:
    """Return whether a magic byte, or the end of the log, follows the record that ends at ``end``."""
    if end + stamp < data.size:
        return YES if data[end + stamp] == MAGIC_V2 or data[end + stamp] == MAGIC_V1 else NO
    if final:
        return YES if end == data.size else NO
    return WAIT


@inlined
def parts_of(data: Bytes, start: int) -> tuple[int, int, int, int]:
    """Return message id, positions of sequence number and CRC, and flags of the frame at ``start``."""
    length = int(np.int64(data[start + 1]))
    if data[start] == MAGIC_V1:
        return int(np.int64(data[start + 5])), start + 2, start + HEAD_V1 + length, MAVLINK1
    number = np.int64(data[start + 7]) | np.int64(data[start + 8]) << 8 | np.int64(data[start + 9]) << 16
    return int(number), start + 4, start + HEAD_V2 + length, SIGNED if data[start + 2] else 0


@inlined
def stamp_at(data: Bytes, place: int) -> int:
    """Return the big-endian time stamp at ``place``, as a signed number."""
    word = load_word(data, place)
    out = np.uint64(0)
    for k in range(8):
        out |= ((word >> np.uint64(8 * k)) & np.uint64(0xFF)) << np.uint64(56 - 8 * k)
    return int(np.int64(out))


@subroutine
def _is_detour(last: int, time_us: int, following: int) -> bool:
    if following < 0:
        return abs(time_us - last) > DAY_US
    way = abs(time_us - last) + abs(following - time_us)
    return way - abs(following - last) > 2 * _STEP_US


@subroutine
def _judge_first_time(data: Bytes, time_us: int, following: int, end: int, final: bool) -> tuple[int, int]:
    """Return whether the first frame's time is valid, and the time to use.

    If it differs by a day from the time of the second record, which begins at ``end``, the third
    record's time decides. If there is no second or no third record, the first time is accepted.
    """
    sound = plausible(time_us)
    if following < 0:
        return (YES, time_us) if sound else (NO, _YEAR_2000_US)
    if not sound:
        return NO, following
    if abs(following - time_us) <= DAY_US:
        return YES, time_us
    second_end = frame_end(data, end + STAMP)
    if second_end == NO:
        return YES, time_us
    if second_end == WAIT:
        return (YES if final else WAIT), time_us
    follow = follows(data, second_end, STAMP, final)
    if follow == WAIT:
        return WAIT, time_us
    if follow == NO or second_end == data.size:
        return YES, time_us
    third = stamp_at(data, second_end)
    if not plausible(third) or abs(third - time_us) <= abs(third - following):
        return YES, time_us
    return NO, following


@subroutine
def time_without_stamp(data: Bytes, end: int, last: int, final: bool) -> tuple[int, int]:
    """Return that the stamp of a frame was cut off, and the time to use: the last one, else the next one."""
    if last >= 0:
        return NO, last
    follow = follows(data, end, STAMP, final)
    if follow == WAIT:
        return WAIT, last
    known = follow == YES and end < data.size and plausible(stamp_at(data, end))
    return NO, stamp_at(data, end) if known else _YEAR_2000_US


@inlined
def judge_time(data: Bytes, position: int, end: int, last: int, final: bool) -> tuple[int, int]:
    """Return whether the time stamp of the record from ``position`` to ``end`` is valid, and the time to use.

    ``last`` is the previous time, -1 if there is none. ``WAIT`` means that more bytes are needed.
    """
    time_us = stamp_at(data, position)
    if last >= 0 and plausible(time_us) and abs(time_us - last) <= _STEP_US:
        return YES, time_us
    follow = follows(data, end, STAMP, final)
    if follow == WAIT:
        return WAIT, time_us
    following = -1
    if follow == YES and end < data.size and plausible(stamp_at(data, end)):
        following = stamp_at(data, end)
    if last < 0:
        return _judge_first_time(data, time_us, following, end, final)
    if not plausible(time_us) or _is_detour(last, time_us, following):
        return NO, last
    return YES, time_us


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


@subroutine
def seed_of(crc: Any, received: Any) -> int:
    """Return the crc_extra that turns ``crc`` into ``received``, or -1 if none does.

    One in 256 damaged frames has one by chance.
    """
    entry = np.uint64(received) ^ (crc >> np.uint64(8))
    index = np.uint64(_BY_HIGH_BYTE[(entry >> np.uint64(8)) & _BYTE])
    if np.uint64(_T0[index]) != entry:
        return -1
    return int((index ^ crc) & _BYTE)
