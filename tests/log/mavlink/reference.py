"""The scanner once more, slow and written for clarity: the oracle of the kernel.

It reads a whole stream at once, with a CRC of another library and Python's integers.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

from fastcrc import crc16

from mavhums.log.mavlink.dialect import Dialect, MessageDefinition

MINUTE_US, DAY_US = 60_000_000, 86_400_000_000
YEAR_2000_US, YEAR_2100_US = 946_684_800_000_000, 4_102_444_800_000_000
MAGIC = (0xFD, 0xFE)


class Frame(NamedTuple):
    """An intact frame: its record's offset in the stream, its payload as sent."""

    offset: int
    time_us: int
    id: int
    system: int
    component: int
    sequence: int
    payload: bytes
    version: int
    signed: bool
    padded: bool
    odd_time: bool


@dataclass
class Scan:
    """All that was found in a stream, known messages and unknown ones in the order of the stream."""

    frames: list[Frame] = field(default_factory=list)
    regions: list[tuple[int, int]] = field(default_factory=list)
    bad_crc: Counter[int] = field(default_factory=Counter)
    cut_end: int = 0
    zeros: int = 0
    odd_times: int = 0
    jumps: int = 0
    rewinds: int = 0
    trials: int = 0


class _Parts(NamedTuple):
    version: int
    signed: bool
    sequence: int
    system: int
    component: int
    id: int
    covered: bytes
    payload: bytes
    crc: int
    end: int


def scan(data: bytes, dialect: Dialect, *, stamp: int = 8) -> Scan:
    """Return every frame of a stream, and what lies between them."""
    found = Scan()
    begin = reserve = 0
    last_us: int | None = None
    last: Frame | None = None
    while begin < len(data):
        frame = _in_step(data, begin, stamp, dialect, last_us, found)
        start = begin - reserve
        while frame is None and start < len(data):
            frame = _out_of_step(data, begin - reserve, start, stamp, dialect, last_us, last)
            start += 1
        if frame is None:
            break
        stamped = frame.offset >= begin - reserve
        skipped = frame.offset - begin + (0 if stamped else stamp)
        if skipped > 0:
            found.regions.append((begin, skipped))
        if stamp and frame.id in dialect.definitions:
            if last_us is not None and not frame.odd_time:
                found.jumps += frame.time_us > last_us + MINUTE_US
                found.rewinds += frame.time_us < last_us - 1_000_000
            found.odd_times += frame.odd_time
            last_us = frame.time_us
        found.frames.append(frame)
        if frame.id in dialect.definitions:
            last = frame
        parts = _parts(data, frame.offset + stamp)
        assert parts is not None
        begin, reserve = parts.end, 13 if parts.signed else 0
    _finish(found, data[begin:], begin)
    return found


def _in_step(
    data: bytes, begin: int, stamp: int, dialect: Dialect, last_us: int | None, found: Scan
) -> Frame | None:
    """Return the frame of the record that begins right after the one before."""
    parts = _parts(data, begin + stamp)
    if parts is None:
        return None
    definition = dialect.definitions.get(parts.id)
    if definition is None:
        accepted = _some_seed_fits(parts) and _follows(data, parts.end, stamp)
        return _frame(data, begin, stamp, parts, False, last_us, None) if accepted else None
    if _crc(parts.covered, definition) == parts.crc:
        return _frame(data, begin, stamp, parts, False, last_us, definition)
    may_be_padded = parts.version == 2 and _follows(data, parts.end, stamp)
    if may_be_padded and _fits_when_padded(parts, definition, found):
        return _frame(data, begin, stamp, parts, True, last_us, definition)
    found.bad_crc[parts.id] += 1
    return None


def _out_of_step(
    data: bytes,
    begin: int,
    start: int,
    stamp: int,
    dialect: Dialect,
    last_us: int | None,
    last: Frame | None,
) -> Frame | None:
    """Return the frame at ``start``, which may lie too close behind ``begin``, the last CRC, for a stamp."""
    parts = _parts(data, start)
    definition = dialect.definitions.get(parts.id) if parts else None
    if parts is None or definition is None or _crc(parts.covered, definition) != parts.crc:
        return None
    position = start - stamp
    stamped = position >= begin
    confirmed = (
        (stamped and _near(data, position, stamp, last_us))
        or _goes_on(parts, last)
        or _follows(data, parts.end, stamp)
    )
    if not confirmed:
        return None
    frame = _frame(data, max(position, 0), stamp, parts, False, last_us, definition)
    if stamped:
        return frame
    time_us = YEAR_2000_US if last_us is None else last_us
    return frame._replace(offset=position, time_us=time_us, odd_time=True)


def _goes_on(parts: _Parts, last: Frame | None) -> bool:
    if last is None or (parts.system, parts.component) != (last.system, last.component):
        return False
    return 1 <= (parts.sequence - last.sequence) % 256 <= 8


def _frame(
    data: bytes,
    position: int,
    stamp: int,
    parts: _Parts,
    padded: bool,
    last_us: int | None,
    definition: MessageDefinition | None,
) -> Frame:
    time_us, odd = -1 if last_us is None else last_us, False
    if stamp and definition:
        time_us, odd = _time(data, position, parts.end, last_us)
    return Frame(
        position, time_us, parts.id, parts.system, parts.component, parts.sequence, parts.payload,
        parts.version, parts.signed, padded, odd,
    )  # fmt: skip


def _parts(data: bytes, start: int) -> _Parts | None:
    if start >= len(data) or data[start] not in MAGIC:
        return None
    version = 2 if data[start] == 0xFD else 1
    head = data[start : start + (10 if version == 2 else 6)]
    if len(head) < (10 if version == 2 else 6) or (version == 2 and head[2] > 1):
        return None
    signed = version == 2 and head[2] == 1
    body = start + len(head)
    crc_at = body + head[1]
    end = crc_at + 2 + (13 if signed else 0)
    if end > len(data):
        return None
    sequence, system, component = head[4:7] if version == 2 else head[2:5]
    number = int.from_bytes(head[7:10], "little") if version == 2 else head[5]
    crc = int.from_bytes(data[crc_at : crc_at + 2], "little")
    covered = data[start + 1 : crc_at]
    return _Parts(version, signed, sequence, system, component, number, covered, data[body:crc_at], crc, end)


def _crc(covered: bytes, definition: MessageDefinition) -> int:
    return crc16.mcrf4xx(covered + bytes([definition.crc_extra]))


def _fits_when_padded(parts: _Parts, definition: MessageDefinition, found: Scan) -> bool:
    for size in range(definition.wire.itemsize, len(parts.payload), -1):
        found.trials += 1
        zeros = bytes(size - len(parts.payload))
        if _crc(bytes([size]) + parts.covered[1:] + zeros, definition) == parts.crc:
            return True
    return False


def _some_seed_fits(parts: _Parts) -> bool:
    return any(crc16.mcrf4xx(parts.covered + bytes([seed])) == parts.crc for seed in range(256))


def _follows(data: bytes, end: int, stamp: int) -> bool:
    return end == len(data) or (end + stamp < len(data) and data[end + stamp] in MAGIC)


def _stamp(data: bytes, place: int) -> int:
    return int.from_bytes(data[place : place + 8], "big")


def _near(data: bytes, position: int, stamp: int, last_us: int | None) -> bool:
    return bool(stamp) and last_us is not None and abs(_stamp(data, position) - last_us) <= DAY_US


def _time(data: bytes, position: int, end: int, last_us: int | None) -> tuple[int, bool]:
    """Return the frame's time, and whether its stamp was damaged."""
    time_us = _stamp(data, position)
    following = None
    if end < len(data) and _follows(data, end, 8) and _stamp(data, end) < YEAR_2100_US:
        following = _stamp(data, end)
    plausible = time_us < YEAR_2100_US
    if last_us is None:
        if plausible and (following is None or abs(following - time_us) <= DAY_US):
            return time_us, False
        if following is None:
            return YEAR_2000_US, True
        if plausible:
            second = _parts(data, end + 8)
            if second is None or second.end == len(data) or not _follows(data, second.end, 8):
                return time_us, False
            third = _stamp(data, second.end)
            if third >= YEAR_2100_US or abs(third - time_us) <= abs(third - following):
                return time_us, False
        return following, True
    step = abs(time_us - last_us)
    if not plausible:
        return last_us, True
    if step <= MINUTE_US:
        return time_us, False
    if following is None:
        odd = step > DAY_US
    else:
        odd = step + abs(following - time_us) - abs(following - last_us) > 2 * MINUTE_US
    return (last_us if odd else time_us), odd


def _finish(found: Scan, rest: bytes, offset: int) -> None:
    """What follows the last frame: zeros, an unfinished record, or damage if it is too long for one."""
    zeros = len(rest) - len(rest.rstrip(b"\0"))
    found.zeros = zeros if zeros >= 16 else 0
    left = len(rest) - found.zeros
    if left > 8 + 10 + 255 + 2 + 13:
        found.regions.append((offset, left))
    else:
        found.cut_end = left
