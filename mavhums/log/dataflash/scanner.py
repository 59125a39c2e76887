"""Scanner that finds the records in a DataFlash log, and reports the unreadable parts.

Results do not depend on where a block of bytes ends: an unfinished record waits.

A record has no checksum. The rules, in the order in which they are applied at each position:

1. Two magic bytes and a type that a FMT record has defined; a FMT record must be plausible in itself.
   One whose length is not that of its fields defines nothing.
2. It must be followed by a record's magic bytes, the end of the log, or one byte repeated to its end.
   In step a record also counts if it is followed by a magic with one bit flipped, or by a gap that begins
   directly after it: at a sector boundary, or zeros after a nonzero byte.
3. A time that steps back by more than 0.1 s, and continues from there, is an old cluster of the disk
   that was not overwritten: its records are omitted until the time is right again or 64 KB have
   passed. After a FMT record of FMT it is the beginning of another log.
4. Otherwise one byte is skipped.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mavhums.core.arrays import Block, Bytes, Bytes1, Bytes2, Records
from mavhums.core.kernels import inlined, kernel, subroutine
from mavhums.log.base.decoder import ODD_TIME
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
)
from mavhums.log.dataflash.layout import (
    BACK,
    BODY,
    DEFINITIONS,
    FMT,
    FMT_BODY,
    FMT_SIZE,
    GAP_US,
    HEAD,
    IN_ORDER,
    MAGIC_1,
    MAGIC_2,
    ODD,
    TYPE,
    begins,
    define,
    is_near,
    judge_time,
    time_at,
)

STATE = counters(
    "base", "position", "time_us", "lost_step", "skipped", "filler", "definitions", "epoch",
    "marked", "boot", "old_from", "old_records", "odd_times", "jumps", "rewinds",
)  # fmt: skip
"""What is carried from block to block.

``base`` is the stream offset of the buffer's first byte after the guard, ``position`` where in the
buffer the scan stopped. Since the last record ``skipped`` counts the bytes skipped and ``filler`` the
equal bytes at their end. ``marked`` is whether a FMT of FMT came since the last time, ``epoch``
counts those, ``old_from`` is the offset at which an old cluster began, or -1.
"""

OLD = 2
"""An answer: the record is one of an old cluster."""

_HELD = 1 << 12
_CLUSTER = 1 << 16
_SECTOR, _BLOCK = 512, 200
_GAP = 8


@subroutine
def _ends_before(data: Bytes, end: int, offset: int, in_step: bool, final: bool) -> int:
    """Return whether a record ending at ``end`` (``offset`` in the stream) counts with no magic after it."""
    if end == data.size:
        return YES if final else WAIT
    if in_step and end + 2 <= data.size:
        off = np.uint8(data[end] ^ MAGIC_1), np.uint8(data[end + 1] ^ MAGIC_2)
        if (off[0] == 0 and off[1] & (off[1] - 1) == 0) or (off[1] == 0 and off[0] & (off[0] - 1) == 0):
            return YES
    filler = data[end]
    run = 1
    while run < _HELD and end + run < data.size and data[end + run] == filler:
        run += 1
    if end + run == data.size and run < _HELD:
        return YES if final else WAIT
    if not in_step:
        return NO
    if filler == 0 and run >= _GAP and (data[end - 1] != 0 or offset % _BLOCK == 0):
        return YES
    return YES if offset % _SECTOR == 0 else NO


@inlined
def _end_of(data: Bytes, position: int, types: Records) -> int:
    """Return the end of the record at ``position``, ``NO`` if there is none, ``WAIT`` if it is cut."""
    if data[position] != MAGIC_1:
        return NO
    if position + HEAD > data.size:
        return WAIT
    if data[position + 1] != MAGIC_2:
        return NO
    length = int(types[data[position + 2]].length)
    if length == 0:
        return NO
    return position + length if position + length <= data.size else WAIT


@inlined
def _step_on(data: Bytes, position: int, state: Record) -> None:
    state.lost_step = 1
    again = state.skipped > 0 and data[position] == data[position - 1]
    state.filler = state.filler + 1 if again else 1
    state.skipped += 1


@inlined
def _counts(data: Bytes, end: int, state: Record, final: bool) -> int:
    """Return whether the bytes after a record that ends at ``end`` confirm it."""
    if end <= NO:
        return NO if final else end
    if end + 2 <= data.size and begins(data, end):
        return YES
    return _ends_before(data, end, state.base + (end - GUARD), state.lost_step == 0, final)


@subroutine
def _out_of_order(state: Record, how: int, time_us: int, offset: int) -> bool:
    """Process a time step, and return whether its record counts."""
    if how == BACK and not state.marked:
        if state.old_from < 0:
            state.old_from = offset
        if offset - state.old_from < _CLUSTER:
            return False
        state.rewinds += 1
    elif state.time_us >= 0 and state.marked:
        state.boot += 1
    elif state.time_us >= 0 and time_us > state.time_us + GAP_US:
        state.jumps += 1
    return True


@inlined
def _take_time(
    data: Bytes, position: int, end: int, state: Record, types: Records, final: bool
) -> tuple[int, int]:
    """Return whether a record with a time counts, and its flags; store the time."""
    time_us = time_at(data, position)
    how = judge_time(data, end, time_us, state.time_us, types, final)
    if how == WAIT:
        return WAIT, 0
    if how == ODD:
        state.odd_times += 1
        return (YES if state.old_from < 0 else OLD), ODD_TIME
    if how != IN_ORDER and not _out_of_order(state, how, time_us, state.base + (position - GUARD)):
        return OLD, 0
    state.time_us = time_us
    state.marked = 0
    state.old_from = -1
    return YES, 0


@subroutine
def _take_definition(data: Bytes, position: int, state: Record, types: Records, bodies: Bytes) -> int:
    """Return whether a FMT record counts; store its definition."""
    if data[position + HEAD] == FMT and state.time_us >= 0:
        state.marked = 1
        state.epoch += 1
    known = define(data, position, state.epoch, types, bodies, state.definitions)
    if known < 0:
        return NO
    state.definitions = known
    return YES if state.old_from < 0 else OLD


@inlined
def _end_region(state: Record, region: Record, offset: int) -> int:
    """Record the bytes skipped before the record at ``offset``; return 1 if there are any, else 0."""
    state.lost_step = 0
    state.filler = 0
    if state.skipped == 0:
        return 0
    region.offset = offset - state.skipped
    region.size = state.skipped
    state.skipped = 0
    return 1


@subroutine
def _run_in_step(data: Bytes, state: Record, types: Records, rows: Records, found: int) -> int:
    """Take records from ``state.position`` on while each is in step and in order; return the number found.

    It takes what the rules below take, and leaves the first record that needs a closer look.
    """
    position, time_us, marked = state.position, state.time_us, state.marked
    ahead, boot = state.base - GUARD, state.boot
    while position + HEAD <= data.size and begins(data, position):
        number = data[position + 2]
        kind = types[number]
        end = position + kind.length
        if kind.length == 0 or number == FMT or end + 2 > data.size or not begins(data, end):
            break
        if kind.timed:
            stamp_us = time_at(data, position)
            if time_us < 0 or not is_near(stamp_us, time_us):
                break
            time_us, marked = stamp_us, 0
        row = rows[found]
        row.offset = ahead + position
        row.time_us = time_us
        row.number = boot
        row.definition = kind.definition
        row.start = HEAD
        row.length = kind.length - HEAD
        row.component = row.sequence = row.flags = 0
        found += 1
        position = end
    state.position, state.time_us, state.marked = position, time_us, marked
    return found


@kernel
def scan(
    data: Bytes1,
    final: bool,
    carried: Annotated[Records, Block(STATE)],
    types: Annotated[Records, Block(TYPE)],
    bodies: Bytes2,
    rows: Rows,
    regions: Regions,
) -> tuple[int, int]:
    """Find the records of a buffer.

    Parameters
    ----------
    data
        ``GUARD`` bytes of any value, then the stream from offset ``carried[0].base`` on.
    final
        Whether this is the end of the stream; an unfinished record is then skipped, else it waits.
    carried
        Shape (1,) of `STATE`, updated.
    types, bodies
        Definitions from FMT records (see `define`); updated.
    rows, regions
        Output: the records, and the skipped regions that end at a record.

    Returns
    -------
    Number of rows, number of regions.
    """
    state = carried[0]
    position = GUARD
    found = 0
    ended = 0
    while position < data.size:
        if state.skipped == 0 and state.old_from < 0:
            state.position = position
            found = _run_in_step(data, state, types, rows, found)
            position = state.position
        end = _end_of(data, position, types)
        counts, flags, kind = _counts(data, end, state, final), 0, 0
        if counts == YES:
            kind = data[position + 2]
            if types[kind].timed:
                counts, flags = _take_time(data, position, end, state, types, final)
            elif kind == FMT:
                counts = _take_definition(data, position, state, types, bodies)
            elif state.old_from >= 0:
                counts = OLD
        if counts == WAIT:
            break
        if counts == NO:
            _step_on(data, position, state)
            position += 1
            continue
        if counts == OLD:
            state.old_records += 1
            state.skipped += end - position
            state.lost_step = state.filler = 0
            position = end
            continue
        offset = state.base + (position - GUARD)
        ended += _end_region(state, regions[ended], offset)
        row = rows[found]
        row.offset = offset
        row.time_us = state.time_us
        row.number = state.boot
        row.definition = types[kind].definition
        row.start = HEAD
        row.length = types[kind].length - HEAD
        row.component = row.sequence = 0
        row.flags = flags
        found += 1
        position = end
    state.position = position
    return found, ended


_LONGEST_RECORD = 255
_SHORTEST_RECORD = 4


class RecordScanner(BlockScanner):
    """Incremental scanner of blocks of any size."""

    def __init__(self) -> None:
        super().__init__(STATE, shortest=_SHORTEST_RECORD)
        self._types = np.zeros(256, dtype=TYPE)
        self._types[FMT] = (FMT_SIZE, 0, 0, 0)
        self._bodies = np.zeros((DEFINITIONS, BODY), dtype=np.uint8)
        self._bodies[0] = np.frombuffer(FMT_BODY, dtype=np.uint8)
        self._carried["time_us"] = self._carried["old_from"] = -1
        self._carried["definitions"] = 1

    @property
    def bodies(self) -> Bytes:
        """Payloads of the FMT records that defined something, shape (definitions, 86)."""
        return self._bodies[: int(self._carried["definitions"][0])]

    def feed(self, block: bytes, *, final: bool = False) -> RecordBatch:
        """Return the records that ``block`` completes; ``final`` says that nothing follows."""

        def find(data: Bytes) -> tuple[int, int]:
            return scan(data, final, self._carried, self._types, self._bodies, self._rows, self._damaged)

        batch = self._scanned(block, find, longest=_LONGEST_RECORD if final else None)
        # Records wait for the flight's date while the next blocks are scanned: those get other memory.
        self._rows = self._rows[:0]
        return batch
