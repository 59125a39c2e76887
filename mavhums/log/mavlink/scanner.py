"""Scanner that finds the MAVLink frames in a stream of bytes, and reports the unreadable parts.

A record is the u64 big-endian time of reception in microseconds of UTC, then a MAVLink 1 or 2
frame. Results do not depend on how the stream is divided into blocks: an unfinished record waits.

The kernel is in step when a record starts directly after the previous one. The rules, in the order
in which they are applied at each position:

1. A frame starts with a magic byte after the time stamp; in MAVLink 2 the only accepted
   incompatibility flag is "signed".
2. A known message is accepted if its CRC is good. One in 64 Ki is good by chance, so out of step
   the frame must also have a time within a day of the last one, or be from the last frame's sender
   with one of its next eight sequence numbers, or be followed by a magic byte. Its time stamp, or
   the signature before it, may be missing.
3. A known message of MAVLink 2 with a bad CRC, in step and followed by a magic byte, is checked
   again with the zeros that some senders trim after they compute the CRC; such a frame is flagged.
4. An unknown message is accepted only in step, if some crc_extra fits its CRC and a magic byte
   follows.
5. Otherwise one byte is skipped.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Block, Bytes, Bytes1, Integers1, Records
from mavhums.core.kernels import inlined, kernel, subroutine
from mavhums.log.base.decoder import MAVLINK1, ODD_TIME, PADDED, SIGNED
from mavhums.log.base.scanner import (
    GUARD,
    NO,
    WAIT,
    YES,
    BlockScanner,
    Record,
    RecordBatch,
    Regions,
    Rows,
    counters,
    plausible,
)
from mavhums.log.mavlink.dialect import Dialect
from mavhums.log.mavlink.frames import (
    DAY_US,
    HEAD_V1,
    HEAD_V2,
    SIGNATURE,
    crc_of,
    finish_crc,
    follows,
    frame_end,
    judge_time,
    parts_of,
    seed_of,
    stamp_at,
    time_without_stamp,
)

STATE = counters(
    "base", "position", "time_us", "lost_step", "reserve", "sender", "sequence", "skipped", "filler",
    "odd_times", "jumps", "rewinds", "padded", "trials",
)  # fmt: skip
"""State carried from block to block.

``base`` is the stream offset of the buffer's first byte after the guard; ``position`` is the
position in the buffer where the scan stopped. Since the last frame, ``lost_step`` is set if the
next record was not at the expected position, ``skipped`` counts the skipped bytes (negative while
the scan tries a record inside the last frame, whose end may be missing), and ``filler`` counts the
zero bytes at their end. ``reserve`` is the size of that frame's signature; ``sender`` is
256 · system + component of the last frame of a known message, and ``sequence`` its sequence number.
``trials`` counts the padded lengths tried.
``time_us`` is -1 before the first frame.
"""

_REWIND_US = 1_000_000
_STEP_US = 60 * 1_000_000


class _Messages(NamedTuple):
    """The messages of a dialect, for the kernel.

    ``ids`` is the row of each message id, -1 for unknown ids. By row, ``seeds`` is the crc_extra, ``largest``
    the largest payload in bytes, and ``bad_crc`` counts bad CRCs. ``scratch`` is space for a padded frame.
    """

    ids: Annotated[NDArray[np.int16], Block(np.int16)]
    seeds: Bytes1
    largest: Annotated[NDArray[np.int32], Block(np.int32)]
    bad_crc: Integers1
    scratch: Bytes1


@subroutine
def _tries_until_crc_fits(
    data: Bytes, start: int, length: int, largest: int, seed: int, scratch: Bytes
) -> int:
    """Try payloads padded with zeros, from ``largest`` bytes down; most such senders trim a full payload.

    Return the number of lengths tried until the CRC matched, or minus that number if none did.
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
    data: Bytes,
    position: int,
    sender: int,
    place: int,
    end: int,
    stamp: int,
    final: bool,
    state: Record,
    message: int,
    flags: int,
    messages: _Messages,
) -> tuple[int, int]:
    """Return whether a frame (sequence number at ``sender``, CRC at ``place``) is accepted, and its flags."""
    start = position + stamp
    received = np.uint64(data[place]) | np.uint64(data[place + 1]) << np.uint64(8)
    crc = crc_of(data, start + 1, place)
    in_step = state.lost_step == 0
    if message < 0:
        if in_step and seed_of(crc, received) >= 0:
            return follows(data, end, stamp, final), flags
        return NO, flags
    if finish_crc(crc, messages.seeds[message]) == received:
        if in_step:
            return YES, flags
        if stamp and _has_stamp(state) and _is_near(state.time_us, stamp_at(data, position)):
            return YES, flags
        if _goes_on(state, data, sender):
            return YES, flags
        return follows(data, end, stamp, final), flags
    length = int(data[start + 1])
    largest = messages.largest[message]
    if not in_step or flags & MAVLINK1 or length >= largest:
        return NO, flags
    follow = follows(data, end, stamp, final)
    if follow != YES:
        return follow, flags
    tries = _tries_until_crc_fits(data, start, length, largest, messages.seeds[message], messages.scratch)
    state.trials += abs(tries)
    return (YES if tries > 0 else NO), flags | PADDED


@inlined
def _is_near(last: int, time_us: int) -> bool:
    return last >= 0 and plausible(time_us) and abs(time_us - last) <= DAY_US


@inlined
def _goes_on(state: Record, data: Bytes, sender: int) -> bool:
    """Return whether a frame has the last one's sender and one of its next eight sequence numbers."""
    identity = np.int64(data[sender + 1]) << 8 | np.int64(data[sender + 2])
    ahead = (np.int64(data[sender]) - state.sequence) & 0xFF
    return bool(identity == state.sender and 1 <= ahead <= 8)


@inlined
def _note_frame(state: Record, data: Bytes, sender: int, message: int, flags: int) -> None:
    state.reserve = SIGNATURE if flags & SIGNED else 0
    if flags & PADDED:
        state.padded += 1
    if message >= 0:
        state.sender = np.int64(data[sender + 1]) << 8 | np.int64(data[sender + 2])
        state.sequence = data[sender]


@inlined
def _has_stamp(state: Record) -> bool:
    """Return whether a time stamp fits between the last frame's CRC and this frame."""
    return bool(state.skipped + state.reserve >= 0)


@inlined
def _step_on(data: Bytes, position: int, stamp: int, state: Record) -> int:
    """Return the next position to scan.

    Out of step the scan continues directly after the last frame's CRC, because its signature or
    the next record's time stamp may be missing; then byte by byte.
    """
    if state.lost_step == 0:
        state.lost_step = 1
        state.skipped = -state.reserve - stamp
        return int(position - state.reserve - stamp)
    if state.skipped >= 0:
        state.filler = state.filler + 1 if data[position] == 0 else 0
    state.skipped += 1
    return position + 1


@inlined
def _end_region(state: Record, region: Record, offset: int, stamp: int) -> int:
    """Record the bytes skipped before the record at ``offset``; return 1 if there are any, else 0."""
    size = state.skipped if _has_stamp(state) else state.skipped + stamp
    region.offset = offset - state.skipped
    region.size = size
    state.lost_step = 0
    state.skipped = 0
    state.filler = 0
    return 1 if size > 0 else 0


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
    data: Bytes1,
    stamp: int,
    final: bool,
    carried: Annotated[Records, Block(STATE)],
    messages: _Messages,
    rows: Rows,
    regions: Regions,
) -> tuple[int, int]:
    """Find the frames of a buffer.

    Parameters
    ----------
    data
        ``GUARD`` bytes of any value, then the stream from offset ``carried[0].base`` on.
    stamp
        Bytes of time stamp before each frame: 8, or 0 in a stream without them.
    final
        Whether this is the end of the stream; an unfinished record is then skipped, else it waits.
    carried
        Shape (1,) of `STATE`, updated.
    messages
        The known messages; ``bad_crc`` is updated.
    rows, regions
        Output: the frames, and the skipped regions that end at a frame.

    Returns
    -------
    Number of rows, number of regions.
    """
    state = carried[0]
    position = GUARD + min(state.skipped, 0)
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
            message = int(messages.ids[number]) if number < messages.ids.size else -1
            accepted, flags = _accept(
                data, position, sender, place, end, stamp, final, state, message, flags, messages
            )
            if accepted == NO and message >= 0 and state.lost_step == 0:
                messages.bad_crc[message] += 1
        if accepted == NO:
            position = _step_on(data, position, stamp, state)
            continue
        sound, time_us = YES, state.time_us
        if not _has_stamp(state):
            sound, time_us = time_without_stamp(data, end, state.time_us, final)
        elif accepted == YES and stamp and message >= 0:
            sound, time_us = judge_time(data, position, end, state.time_us, final)
        if min(accepted, sound) == WAIT:
            break
        if stamp and message >= 0:
            _note_time(state, sound == YES, time_us)
        offset = state.base + (position - GUARD)
        if state.lost_step:
            ended += _end_region(state, regions[ended], offset, stamp)
        _note_frame(state, data, sender, message, flags)
        row = rows[found]
        row.offset = offset
        row.time_us = time_us
        row.number = number
        row.crc = np.int64(data[place]) | np.int64(data[place + 1]) << 8
        row.definition = message
        row.start = stamp + (HEAD_V1 if flags & MAVLINK1 else HEAD_V2)
        row.sequence = data[sender]
        row.system = data[sender + 1]
        row.component = data[sender + 2]
        row.length = data[start + 1]
        row.flags = flags | (ODD_TIME if sound == NO else 0)
        found += 1
        position = end
    state.position = position - min(state.skipped, 0)
    return found, ended


_LONGEST_RECORD = 8 + 10 + 255 + 2 + 13


class FrameScanner(BlockScanner):
    """Incremental scanner of blocks of any size.

    Parameters
    ----------
    dialect
        Dialect of the known messages.
    stamp
        Size of the time stamp before each frame, bytes: 8, or 0 for back-to-back frames.
    mend
        Whether frames with a bad CRC are checked again with the zeros that some senders trim.

    Attributes
    ----------
    bad_crc
        Number of frames in step with a bad CRC, by row of the dialect, shape (messages,).
    """

    def __init__(self, dialect: Dialect, *, stamp: int = 8, mend: bool = True) -> None:
        super().__init__(STATE, shortest=8 + stamp)
        ids, seeds, largest = _by_row(dialect)
        self.bad_crc = np.zeros(seeds.size, dtype=np.int64)
        scratch = np.zeros(GUARD + 265, dtype=np.uint8)
        self._messages = _Messages(ids, seeds, largest if mend else 0 * largest, self.bad_crc, scratch)
        self._stamp = stamp
        self._carried["time_us"] = self._carried["sender"] = -1

    def feed(self, block: bytes, *, final: bool = False) -> RecordBatch:
        """Return the frames that ``block`` completes; ``final`` marks the end of the stream."""

        def find(data: Bytes) -> tuple[int, int]:
            return scan(data, self._stamp, final, self._carried, self._messages, self._rows, self._damaged)

        batch = self._scanned(block, find, longest=_LONGEST_RECORD if final else None)
        return replace(batch, stamp=self._stamp)


@cache
def _by_row(dialect: Dialect) -> tuple[NDArray[np.int16], Bytes, NDArray[np.int32]]:
    """Return a dialect as arrays for the kernel: row by message id, then crc_extra and size by row."""
    definitions = dialect.definitions
    ids = np.full(max(definitions) + 1, -1, dtype=np.int16)
    ids[list(definitions)] = np.arange(len(definitions))
    seeds = np.array([d.crc_extra for d in definitions.values()], dtype=np.uint8)
    largest = np.array([d.wire.itemsize for d in definitions.values()], dtype=np.int32)
    return ids, seeds, largest
