"""The scan kernel: one pass over a block, from bytes to one row per intact frame.

The rules, in the order in which they are asked at each place:

1. A magic byte after the time stamp; in MAVLink 2 no incompatibility flag but "signed".
2. A known message counts with a good CRC; out of step it must also bear a time within a day of the
   last, or be followed by a magic byte, for in the 64 KiB after damage one CRC fits by chance.
3. A known message of MAVLink 2 with a bad CRC, in step and followed by a magic byte, is tried with
   the zeros that a sender trimmed after it had computed the CRC; such a frame is flagged.
4. An unknown message counts in step only, if some crc_extra fits its CRC and a magic byte follows.
5. Anything else: one byte is skipped.

A time more than a minute from the last is held against the next record's: if the way over it is a
detour of more than two minutes it is damaged, else the clock was set or the link was silent.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mavhums.log._crc import GUARD, crc_of, finish_crc, load_word, seed_of

__all__ = [
    "FLAG_MAVLINK1",
    "FLAG_ODD_TIME",
    "FLAG_PADDED",
    "FLAG_SIGNED",
    "REGION",
    "ROW",
    "STATE",
    "scan",
]

ROW = np.dtype(
    [
        ("offset", "i8"),
        ("time_us", "i8"),
        ("id", "i4"),
        ("crc", "u2"),
        ("message", "i2"),
        ("system", "u1"),
        ("component", "u1"),
        ("sequence", "u1"),
        ("length", "u1"),
        ("flags", "u1"),
    ],
    align=True,
)
"""One frame: ``offset`` of its record in the stream, ``message`` the row of its definition or -1."""

REGION = np.dtype([("offset", "i8"), ("size", "i8")])
STATE = np.dtype(
    [
        ("base", "i8"),
        ("position", "i8"),
        ("time_us", "i8"),
        ("skipped", "i8"),
        ("zeros", "i8"),
        ("odd_times", "i8"),
        ("jumps", "i8"),
        ("rewinds", "i8"),
        ("padded", "i8"),
        ("trials", "i8"),
    ]
)
"""What is carried from block to block.

``base`` is the stream offset of the buffer's first byte after the guard, ``position`` where in the
buffer the scan stopped, ``skipped`` and ``zeros`` count the bytes skipped and the zero bytes seen
since the last frame, ``trials`` the padded lengths tried. ``time_us`` is -1 before the first frame.
"""

FLAG_MAVLINK1, FLAG_SIGNED, FLAG_PADDED, FLAG_ODD_TIME = 1, 2, 4, 8

_V1, _V2 = 0xFE, 0xFD
_STEP_US = 60 * 1_000_000
_REWIND_US = 1_000_000
_DAY_US = 86_400 * 1_000_000
_YEAR_2000_US, _YEAR_2100_US = 946_684_800_000_000, 4_102_444_800_000_000
_YES, _NO, _WAIT = 1, 0, -1


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _frame_end(data: NDArray[np.uint8], start: int, size: int) -> int:
    """Return where the frame at ``start`` ends, 0 if there is none, -1 if its head is incomplete."""
    if start >= size:
        return _WAIT
    if data[start] == _V2:
        if start + 10 > size:
            return _WAIT
        flags = data[start + 2]
        if flags > 1:
            return _NO
        return start + 12 + np.int64(data[start + 1]) + 13 * np.int64(flags)
    if data[start] == _V1:
        if start + 6 > size:
            return _WAIT
        return start + 8 + np.int64(data[start + 1])
    return _NO


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _follows(data: NDArray[np.uint8], end: int, size: int, stamp: int, final: bool) -> int:
    """Return whether a magic byte, or the end of the log, follows the record that ends at ``end``."""
    if end + stamp < size:
        return _YES if data[end + stamp] == _V2 or data[end + stamp] == _V1 else _NO
    if final:
        return _YES if end == size else _NO
    return _WAIT


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _stamp_at(data: NDArray[np.uint8], place: int) -> int:
    word = load_word(data, place)
    out = np.uint64(0)
    for k in range(8):
        out |= ((word >> np.uint64(8 * k)) & np.uint64(0xFF)) << np.uint64(56 - 8 * k)
    return np.int64(out)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _plausible(time_us: int) -> bool:
    return 0 <= time_us < _YEAR_2100_US


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _is_detour(last: int, time_us: int, following: int) -> bool:
    """Return whether ``time_us`` lies so far off the way from the last time to the following."""
    if following < 0:
        return abs(time_us - last) > _DAY_US
    way = abs(time_us - last) + abs(following - time_us)
    return way - abs(following - last) > 2 * _STEP_US


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _judge_first_time(
    data: NDArray[np.uint8], time_us: int, following: int, end: int, final: bool
) -> tuple[int, int]:
    """Return the first frame's time, and whether its stamp is sound.

    Where it is a day off the second record's, which begins at ``end``, the third one's decides.
    """
    sound = _plausible(time_us)
    if following < 0 or (sound and abs(following - time_us) <= _DAY_US):
        return (time_us if sound else _YEAR_2000_US), (_YES if sound else _NO)
    if sound:
        second_end = _frame_end(data, end + 8, data.size)
        if second_end < 0 and not final:
            return time_us, _WAIT
        if second_end > 0:
            follows = _follows(data, second_end, data.size, 8, final)
            if follows == _WAIT:
                return time_us, _WAIT
            if follows == _NO or second_end == data.size:
                return time_us, _YES
            third = _stamp_at(data, second_end)
            if abs(third - time_us) <= abs(third - following):
                return time_us, _YES
    return following, _NO


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def _tries_until_crc_fits(
    data: NDArray[np.uint8], start: int, length: int, largest: int, seed: int, scratch: NDArray[np.uint8]
) -> int:
    """Try payloads padded with zeros, from ``largest`` bytes down; most such senders trimmed a whole payload.

    Return the number of lengths tried until the CRC fitted, or minus that number if none did.
    """
    covered = 9 + length
    scratch[GUARD : GUARD + covered] = data[start + 1 : start + 1 + covered]
    scratch[GUARD + covered :] = 0
    received = np.uint64(data[start + 10 + length]) | np.uint64(data[start + 11 + length]) << np.uint64(8)
    for padded in range(largest, length, -1):
        scratch[GUARD] = padded
        if finish_crc(crc_of(scratch, GUARD, GUARD + 9 + padded), seed) == received:
            return largest - padded + 1
    return length - largest


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
def scan(
    data: NDArray[np.uint8],
    stamp: int,
    final: bool,
    carried: NDArray[np.void],
    ids: NDArray[np.int16],
    seeds: NDArray[np.uint8],
    largest: NDArray[np.int32],
    bad_crc: NDArray[np.int64],
    rows: NDArray[np.void],
    regions: NDArray[np.void],
    scratch: NDArray[np.uint8],
) -> tuple[int, int]:
    """Find the frames of a buffer.

    Parameters
    ----------
    data
        ``GUARD`` bytes of any value, then the stream from offset ``carried[0].base`` on.
    stamp
        Bytes of time stamp before each frame: 8, or 0 in a stream without them.
    final
        Whether nothing follows; an unfinished record is skipped then, else it waits.
    carried
        Shape (1,) of `STATE`, updated.
    ids
        Row of the definition by message id, -1 where unknown.
    seeds, largest, bad_crc
        By row: crc_extra, largest payload in bytes, and the count of bad CRCs, updated.
    rows, regions
        Written: the frames, and the skipped regions that a frame has ended.
    scratch
        Shape (GUARD + 265,).

    Returns
    -------
    Number of rows, number of regions.
    """
    state = carried[0]
    size = data.size
    position = GUARD
    found = 0
    ended = 0
    while position < size:
        start = position + stamp
        end = _frame_end(data, start, size)
        if end > size or end < 0:
            if not final:
                break
            end = 0
        accepted = _NO
        flags = 0
        if end > 0:
            length = np.int64(data[start + 1])
            if data[start] == _V2:
                head = 10
                number = (
                    np.int64(data[start + 7])
                    | np.int64(data[start + 8]) << 8
                    | np.int64(data[start + 9]) << 16
                )
                sender = start + 4
                flags = FLAG_SIGNED if data[start + 2] else 0
            else:
                head = 6
                number = np.int64(data[start + 5])
                sender = start + 2
                flags = FLAG_MAVLINK1
            place = start + head + length
            message = np.int64(ids[number]) if number < ids.size else np.int64(-1)
            received = np.uint64(data[place]) | np.uint64(data[place + 1]) << np.uint64(8)
            crc = crc_of(data, start + 1, place)
            if message >= 0:
                if finish_crc(crc, seeds[message]) == received:
                    accepted = _YES
                    if state.skipped:
                        near = stamp and abs(_stamp_at(data, position) - state.time_us) <= _DAY_US
                        if not near or state.time_us < 0:
                            accepted = _follows(data, end, size, stamp, final)
                elif state.skipped == 0:
                    if flags != FLAG_MAVLINK1 and length < largest[message]:
                        accepted = _follows(data, end, size, stamp, final)
                        if accepted == _YES:
                            tries = _tries_until_crc_fits(
                                data, start, length, largest[message], seeds[message], scratch
                            )
                            state.trials += abs(tries)
                            accepted = _YES if tries > 0 else _NO
                            flags |= FLAG_PADDED
                    if accepted == _NO:
                        bad_crc[message] += 1
            elif state.skipped == 0 and seed_of(crc, received) >= 0:
                accepted = _follows(data, end, size, stamp, final)
        if accepted == _WAIT:
            break
        if accepted == _NO:
            state.skipped += 1
            state.zeros = state.zeros + 1 if data[position] == 0 else 0
            position += 1
            continue
        time_us = state.time_us
        if stamp and message >= 0:
            time_us = _stamp_at(data, position)
            last = state.time_us
            if last < 0 or not _plausible(time_us) or abs(time_us - last) > _STEP_US:
                follows = _follows(data, end, size, stamp, final)
                if follows == _WAIT:
                    break
                following = np.int64(-1)
                if follows == _YES and end < size:
                    following = _stamp_at(data, end)
                    if not _plausible(following):
                        following = -1
                if last < 0:
                    time_us, sound = _judge_first_time(data, time_us, following, end, final)
                    if sound == _WAIT:
                        break
                    odd = sound == _NO
                else:
                    odd = not _plausible(time_us) or _is_detour(last, time_us, following)
                    if odd:
                        time_us = last
                    elif time_us > last:
                        state.jumps += 1
                    else:
                        state.rewinds += 1
                if odd:
                    flags |= FLAG_ODD_TIME
                    state.odd_times += 1
            elif time_us < last - _REWIND_US:
                state.rewinds += 1
            state.time_us = time_us
        if state.skipped:
            regions[ended].offset = state.base + (position - GUARD) - state.skipped
            regions[ended].size = state.skipped
            ended += 1
            state.skipped = 0
            state.zeros = 0
        if flags & FLAG_PADDED:
            state.padded += 1
        row = rows[found]
        row.offset = state.base + (position - GUARD)
        row.time_us = time_us
        row.id = number
        row.crc = received
        row.message = message
        row.system = data[sender + 1]
        row.component = data[sender + 2]
        row.sequence = data[sender]
        row.length = length
        row.flags = flags
        found += 1
        position = end
    state.position = position
    return found, ended
