"""The scan kernel: one pass over a block, from bytes to one row per intact frame.

The rules, in the order in which they are asked at each place:

1. A magic byte after the time stamp; in MAVLink 2 no incompatibility flag but "signed".
2. A known message counts with a good CRC; out of step it must also bear a time within a day of the
   last, or be followed by a magic byte, for in the 64 KiB after damage one CRC fits by chance.
3. A known message of MAVLink 2 with a bad CRC, in step and followed by a magic byte, is tried with
   the zeros that a sender trimmed after it had computed the CRC; such a frame is flagged.
4. An unknown message counts in step only, if some crc_extra fits its CRC and a magic byte follows.
5. Anything else: one byte is skipped.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums.log._crc import GUARD, crc_of, finish_crc, seed_of
from mavhums.log._frame import (
    NO,
    WAIT,
    YES,
    follows,
    frame_end,
    parts_of,
)
from mavhums.log._jit import inlined, kernel
from mavhums.log._times import DAY_US, judge_time, plausible, stamp_at
from mavhums.log.flags import MAVLINK1, ODD_TIME, PADDED

__all__ = ["REGION", "ROW", "STATE", "scan"]

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

_REWIND_US = 1_000_000
_STEP_US = 60 * 1_000_000

Record = Any
"""An element of a structured array, within compiled code."""


@kernel
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


@inlined
def _accept(
    data: NDArray[np.uint8],
    position: int,
    place: int,
    end: int,
    stamp: int,
    final: bool,
    state: Record,
    message: int,
    flags: int,
    seeds: NDArray[np.uint8],
    largest: NDArray[np.int32],
    scratch: NDArray[np.uint8],
) -> tuple[int, int]:
    """Return whether the frame whose CRC lies at ``place`` counts, and its flags."""
    start = position + stamp
    received = np.uint64(data[place]) | np.uint64(data[place + 1]) << np.uint64(8)
    crc = crc_of(data, start + 1, place)
    in_step = state.skipped == 0
    if message < 0:
        if in_step and seed_of(crc, received) >= 0:
            return follows(data, end, stamp, final), flags
        return NO, flags
    if finish_crc(crc, seeds[message]) == received:
        if in_step or (stamp and _is_near(state.time_us, stamp_at(data, position))):
            return YES, flags
        return follows(data, end, stamp, final), flags
    length = int(data[start + 1])
    if not in_step or flags & MAVLINK1 or length >= largest[message]:
        return NO, flags
    follow = follows(data, end, stamp, final)
    if follow != YES:
        return follow, flags
    tries = _tries_until_crc_fits(data, start, length, largest[message], seeds[message], scratch)
    state.trials += abs(tries)
    return (YES if tries > 0 else NO), flags | PADDED


@inlined
def _is_near(last: int, time_us: int) -> bool:
    return last >= 0 and plausible(time_us) and abs(time_us - last) <= DAY_US


@inlined
def _skip(state: Record, byte: int) -> None:
    state.skipped += 1
    state.zeros = state.zeros + 1 if byte == 0 else 0


@inlined
def _end_region(state: Record, region: Record, offset: int) -> None:
    region.offset = offset - state.skipped
    region.size = state.skipped
    state.skipped = 0
    state.zeros = 0


@inlined
def _note_time(state: Record, sound: bool, time_us: int) -> None:
    last = state.time_us
    if not sound:
        state.odd_times += 1
    elif last >= 0:
        if time_us > last + _STEP_US:
            state.jumps += 1
        elif time_us < last - _REWIND_US:
            state.rewinds += 1
    state.time_us = time_us


@kernel
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
    position = GUARD
    found = 0
    ended = 0
    while position < data.size:
        start = position + stamp
        end = frame_end(data, start)
        if end > data.size or end == WAIT:
            if not final:
                break
            end = NO
        accepted, message, number, sender, place, flags = NO, -1, 0, 0, 0, 0
        if end != NO:
            number, sender, place, flags = parts_of(data, start)
            message = int(ids[number]) if number < ids.size else -1
            accepted, flags = _accept(
                data, position, place, end, stamp, final, state, message, flags, seeds, largest, scratch
            )
            if accepted == NO and message >= 0 and state.skipped == 0:
                bad_crc[message] += 1
        if accepted == NO:
            _skip(state, data[position])
            position += 1
            continue
        sound, time_us = YES, state.time_us
        if accepted == YES and stamp and message >= 0:
            sound, time_us = judge_time(data, position, end, state.time_us, final)
        if min(accepted, sound) == WAIT:
            break
        if stamp and message >= 0:
            _note_time(state, sound == YES, time_us)
        offset = state.base + (position - GUARD)
        if state.skipped:
            _end_region(state, regions[ended], offset)
            ended += 1
        if flags & PADDED:
            state.padded += 1
        row = rows[found]
        row.offset = offset
        row.time_us = time_us
        row.id = number
        row.crc = np.int64(data[place]) | np.int64(data[place + 1]) << 8
        row.message = message
        row.sequence = data[sender]
        row.system = data[sender + 1]
        row.component = data[sender + 2]
        row.length = data[start + 1]
        row.flags = flags | (ODD_TIME if sound == NO else 0)
        found += 1
        position = end
    state.position = position
    return found, ended
