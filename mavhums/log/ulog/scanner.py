"""Scanner that finds the messages in a ULog, and reports the unreadable parts.

Results do not depend on where a block of bytes ends: an unfinished message waits. Data appended to a log
later, for example after a crash, begins at the offset in the flag bits; the message before may be cut there.

A message counts if its kind is known, its size is valid for this kind, and another message, or
the end, follows. Out of step, after damage, this is checked at every byte. The pass pauses after a
subscription, so that the layout of the following messages is known.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from mavhums.core.arrays import Block, Bytes, Bytes1, Records
from mavhums.core.kernels import inlined, kernel, load_word, subroutine
from mavhums.log.base.decoder import ODD_TIME
from mavhums.log.base.scanner import (
    GUARD,
    NO,
    REGION,
    SPARE,
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
from mavhums.log.ulog.layouts import (
    BODY,
    TOPIC,
    UNKNOWN,
    UNUSED,
    Topics,
    follows,
    header_fits,
    kind_of,
    landing,
    looks_sound,
    size_of,
    topic_of,
)

STATE = counters(
    "base", "position", "found", "ended", "lost_step", "skipped", "filler", "begun_us", "time_us",
    "astray", "run", "odd_times", "jumps", "unknown", "pauses", "cut",
)  # fmt: skip
"""What is carried from call to call.

``base`` is the stream offset of the buffer's first byte, ``position`` where in the buffer the scan
stopped, ``found`` and ``ended`` how many rows and regions of this buffer are written. Since the last
message ``lost_step`` is whether the next was not at its expected place, ``skipped`` counts the bytes
skipped and ``filler`` the zero bytes at their end. ``begun_us`` is the header's time, ``time_us`` the
clock, ``astray`` the last time that was too far from it, ``run`` how many in a row were near that one.
``unknown`` counts messages of unknown kinds, ``cut`` is whether the end cuts a message.
"""

MOST_PAUSES = 1 << 16
_STEP_US = 60 * 1_000_000
_CONFIRM = 3
_DAMAGED = 2
_A, _D, _R = ord("A"), ord("D"), ord("R")


@inlined
def _judge_time(state: Record, stamp_us: int) -> bool:
    """Accept a record's time within a minute of the clock; three consecutive other times set the clock.

    Several topics are logged with one time: where it is wrong, it is one wrong time. A header without a time
    sets no clock.
    """
    if not plausible(stamp_us) or stamp_us < state.begun_us:
        return False
    if abs(stamp_us - state.time_us) <= _STEP_US or (state.time_us == 0 and stamp_us > 0):
        state.time_us = stamp_us
        state.run = 0
        return True
    if stamp_us <= 0 or (state.run and stamp_us == state.astray):
        return False
    state.run = state.run + 1 if state.run and abs(stamp_us - state.astray) <= _STEP_US else 1
    state.astray = stamp_us
    if state.run < _CONFIRM:
        return False
    state.time_us = stamp_us
    state.run = 0
    state.jumps += 1
    return True


@inlined
def _note_region(state: Record, regions: Records, offset: int, size: int) -> None:
    region = regions[state.ended]
    region.offset = offset
    region.size = size
    state.ended += 1


@inlined
def _note_row(state: Record, row: Record, data: Bytes, position: int, topics: Records) -> None:
    row.offset = state.base + position
    row.start = BODY
    row.length = size_of(data, position)
    row.number = kind_of(data, position)
    row.definition = -1
    row.component = row.sequence = row.flags = 0
    if row.number == _D:
        row.start += 2
        row.length -= 2
        topic = topics[topic_of(data, position)]
        row.definition = topic.definition
        row.component = topic.instance
        if topic.stamp >= 0:
            stamp_us = int(np.int64(load_word(data, position + BODY + 2 + topic.stamp)))
            if _judge_time(state, stamp_us):
                topic.timed = 1
            else:
                row.flags = ODD_TIME
                # What was published before the logger began is old, not damaged.
                state.odd_times += topic.timed and not 0 <= stamp_us < state.begun_us
    row.time_us = state.time_us


@inlined
def _is_data(data: Bytes, place: int, topics: Records) -> bool:
    """Return whether a record of a known layout begins at ``place``; five bytes must be readable there."""
    topic = topics[topic_of(data, place)]
    size = size_of(data, place) - 2
    return bool(kind_of(data, place) == _D and topic.least <= size <= topic.most and topic.definition >= 0)


@subroutine
def _run_of_data(data: Bytes, position: int, state: Record, topics: Records, rows: Records) -> int:
    """Write rows for regular records in step; return the position of the first irregularity.

    `scan` finds the same rows, but checks each more thoroughly.
    """
    last = data.size - BODY - 2
    found, clock = state.found, state.time_us
    here = position <= last and _is_data(data, position, topics)
    while here:
        size = size_of(data, position)
        end = position + BODY + size
        if end > last or not _is_data(data, end, topics):
            break
        topic = topics[topic_of(data, position)]
        if topic.stamp < 0:
            break
        stamp_us = np.int64(load_word(data, position + BODY + 2 + topic.stamp))
        if abs(stamp_us - clock) > _STEP_US or not plausible(stamp_us):
            break
        clock = stamp_us
        topic.timed = 1
        row = rows[found]
        row.offset = state.base + position
        row.time_us = stamp_us
        row.definition = topic.definition
        row.start = BODY + 2
        row.length = size - 2
        row.number = _D
        row.component = topic.instance
        row.sequence = row.flags = 0
        found += 1
        position = end
    if found > state.found:
        state.run = 0
    state.found, state.time_us = found, clock
    return position


@inlined
def _pass_damaged(
    state: Record,
    data: Bytes,
    position: int,
    end: int,
    topics: Records,
    regions: Records,
) -> None:
    """Count a message with a damaged header and a known end."""
    kind = kind_of(data, position)
    if kind == _D and topics[topic_of(data, position)].definition == UNUSED:
        topic = topics[topic_of(data, position)]
        topic.definition = UNKNOWN
        topic.least = topic.most = size_of(data, position) - 2
    if kind == _D or kind < 65 or kind > 90 or end != position + BODY + size_of(data, position):
        _note_region(state, regions, state.base + position, end - position)
    else:
        state.unknown += 1


@subroutine
def _judge(data: Bytes, position: int, final: bool, state: Record, topics: Records) -> tuple[int, int]:
    """Return whether a message that counts begins at ``position``, and its end.

    ``_DAMAGED`` is a message with a damaged header and a known end.
    """
    in_step = state.lost_step == 0
    if position + BODY > data.size:
        state.cut |= in_step
        return (NO if final else WAIT), position
    fits = header_fits(data, position, final, topics)
    if fits == YES:
        end = position + BODY + size_of(data, position)
        if end > data.size:
            state.cut |= in_step
            return (NO if final else WAIT), position
        if in_step or looks_sound(data, position):
            return follows(data, position, final, topics, not in_step), end
        return NO, position
    if fits == NO and in_step:
        passed, end = landing(data, position, final, topics)
        return (_DAMAGED if passed == YES else passed), end
    return fits, position


@kernel
def scan(
    data: Bytes1,
    final: bool,
    carried: Annotated[Records, Block(STATE)],
    topics: Annotated[Records, Block(TOPIC)],
    rows: Rows,
    regions: Regions,
) -> bool:
    """Find the messages of a buffer, from ``carried[0].position`` on.

    Parameters
    ----------
    data
        The stream from offset ``carried[0].base`` on.
    final
        Whether this is the end of the stream; an unfinished message is then skipped, else it waits.
    carried
        Shape (1,) of `STATE`, updated.
    topics
        Shape (65536,) of `TOPIC`, by message id; undefined ids are marked.
    rows, regions
        Output: the messages, and the skipped regions that end at a message.

    Returns
    -------
    Whether the scan paused after a subscription and must be called again.
    """
    state = carried[0]
    position = state.position
    while position < data.size:
        if state.lost_step == 0:
            position = _run_of_data(data, position, state, topics, rows)
        answer, end = _judge(data, position, final, state, topics)
        if answer == WAIT:
            break
        if answer == NO:
            state.lost_step = 1
            state.skipped += 1
            state.filler = state.filler + 1 if data[position] == 0 else 0
            position += 1
            continue
        if answer == _DAMAGED:
            _pass_damaged(state, data, position, end, topics, regions)
            position = end
            continue
        if state.lost_step:
            _note_region(state, regions, state.base + position - state.skipped, state.skipped)
            state.lost_step = state.skipped = state.filler = state.cut = 0
        kind = kind_of(data, position)
        if kind == _D and topics[topic_of(data, position)].definition == UNKNOWN:
            topics[topic_of(data, position)].unknown += 1
        else:
            _note_row(state, rows[state.found], data, position, topics)
            state.found += 1
        position = end
        if (kind in (_A, _R)) and state.pauses < MOST_PAUSES:
            state.pauses += 1
            state.position = position
            return True
    state.position = position
    return False


HEADER = 16
"""Bytes of a file's header: seven of signature, the version, the u64 time in microseconds since boot."""

SIGNATURE = b"ULog\x01\x12\x35"
_FLAGS_BODY = 40
_LONGEST_FLAGS = 1000
_DEFINING = np.isin(np.arange(256), np.frombuffer(b"FAR", dtype=np.uint8))
_ANY_LENGTH = 1 << 62


def flag_bits(body: bytes) -> tuple[bool, list[int]]:
    """Return whether only a newer reader can read a log, and the offsets at which data was appended later.

    ``body`` is that of the log's first message, at least 40 bytes.

    Examples
    --------
    >>> flag_bits(bytes(8) + b"\\x01" + bytes(7) + (500).to_bytes(8, "little") + bytes(16))
    (False, [500])
    """
    unknown = body[8] & 0xFE or any(body[9:16])
    offsets = struct.unpack("<3Q", body[16:40]) if body[8] & 1 else ()
    return bool(unknown), sorted(offset for offset in offsets if offset)


class UlogScanner(BlockScanner):
    """Incremental scanner of blocks of any size.

    Attributes
    ----------
    topics
        The log's message ids.
    """

    def __init__(self) -> None:
        super().__init__(STATE, shortest=BODY)
        self.topics = Topics()
        self._boundaries: list[int] = []
        self._open = False

    def feed(self, block: bytes, *, final: bool = False) -> Iterator[RecordBatch]:
        """Yield the messages that ``block`` completes; ``final`` says that nothing follows."""
        joined = self._joined(block)
        begin, end = GUARD, len(joined) - SPARE
        if not self._open:
            begin += self._read_header(joined[GUARD:end], final)
            if not self._open:
                self._carry(joined, GUARD)
                return
        data = np.frombuffer(joined, dtype=np.uint8)
        before = self.position - begin
        while self._boundaries and self._boundaries[0] <= before + end:
            boundary = self._boundaries.pop(0) - before
            if boundary > begin:
                yield self._scan(data, begin, boundary, final=True)
                begin = boundary
        batch = self._scan(data, begin, end, final=final)
        self._carry(joined, begin + int(self._carried["position"][0]))
        yield batch

    def _read_header(self, head: bytes, final: bool) -> int:
        """Read the file's header and its flag bits, if they are complete; return their end."""
        end = HEADER + BODY
        size = int.from_bytes(head[HEADER : HEADER + 2], "little")
        flagged = head[HEADER + 2 : end] == b"B" and _FLAGS_BODY <= size <= _LONGEST_FLAGS
        if len(head) < end + size * flagged and not final:
            return 0
        self._open = True
        damaged = not SIGNATURE.startswith(head[: len(SIGNATURE)])
        if damaged and not flagged:  # whatever is left of the header is skipped as damage
            return 0
        if damaged:
            self._add_damage(np.array([(0, HEADER)], dtype=REGION))
        begun_us = int.from_bytes(head[8:HEADER], "little")
        self._carried["begun_us"] = self._carried["time_us"] = begun_us if plausible(begun_us) else 0
        place = min(HEADER, len(head))
        if place < HEADER:
            self._cut = place
        elif flagged and len(head) >= end + size:
            _, self._boundaries = flag_bits(head[end : end + size])
            place = end + size
        self._carried["base"] = place
        return place

    def _scan(self, data: Bytes, begin: int, end: int, *, final: bool) -> RecordBatch:
        """Scan a part of the buffer; ``position`` is where in it the scan stopped."""
        state = self._carried[0]
        batch = RecordBatch(data[begin - GUARD : end + SPARE], self.position, self._rows[:0])
        for name in ("position", "found", "ended", "cut"):
            state[name] = 0
        handled, paused = 0, True
        while paused:
            paused = bool(
                scan(data[begin:end], final, self._carried, self.topics.ids, self._rows, self._damaged)
            )
            found = int(state["found"])
            for row in self._rows[handled:found][_DEFINING[self._rows["number"][handled:found]]]:
                self.topics.observe(int(row["number"]), batch.payload(row))
            handled = found
        self._add_damage(self._damaged[: int(state["ended"])])
        state["base"] += state["position"]
        if final:
            # The kernel knows whether the end cuts a message; else the rest is damage, of any length.
            self._finish(longest=_ANY_LENGTH if state["cut"] else 0)
            state["lost_step"] = 0
        # A copy: messages wait for the flight's date while the next blocks are scanned.
        return RecordBatch(batch.data, batch.base, self._rows[:handled].copy())
