"""The scanner once more, slow and written for clarity: the oracle of the kernel.

It reads a whole stream at once, with Python's integers and the rules as the kernel's module states them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import NamedTuple

MAGIC = b"\xa3\x95"
SIZES = {
    "a": 64, "b": 1, "B": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "d": 8, "g": 2, "n": 4, "N": 16,
    "Z": 64, "c": 2, "C": 2, "e": 4, "E": 4, "L": 4, "M": 1, "q": 8, "Q": 8,
}  # fmt: skip
STEP_US, MINUTE_US = 100_000, 60_000_000
FILLER, CLUSTER, DEFINITIONS = 4096, 65536, 1024


class Record(NamedTuple):
    """An intact record: its offset, its type's definition as sent, and its time since boot."""

    offset: int
    definition: bytes
    payload: bytes
    time_us: int
    boot: int
    odd_time: bool


@dataclass
class Kind:
    """What a FMT record says."""

    body: bytes
    length: int
    timed: bool
    epoch: int


@dataclass
class Scan:
    """All that was found in a stream."""

    records: list[Record] = field(default_factory=list)
    regions: list[tuple[int, int]] = field(default_factory=list)
    tail: int = 0
    old: int = 0
    odd_times: int = 0
    jumps: int = 0
    rewinds: int = 0


class _Scanner:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.found = Scan()
        self.kinds = {128: Kind(b"FMT", 89, False, 0)}
        self.definitions = 1
        self.last = -1
        self.epoch = self.boot = 0
        self.marked = False
        self.old_from: int | None = None

    def scan(self) -> Scan:
        position = skipped = 0
        in_step = True
        while position < len(self.data):
            verdict, flags = self._judge(position, in_step)
            if verdict == "damage":
                position, skipped, in_step = position + 1, skipped + 1, False
                continue
            size = self.kinds[self.data[position + 2]].length
            if verdict == "old":
                self.found.old += 1
                position, skipped, in_step = position + size, skipped + size, True
                continue
            if skipped:
                self.found.regions.append((position - skipped, skipped))
                skipped = 0
            kind = self.kinds[self.data[position + 2]]
            payload = self.data[position + 3 : position + size]
            self.found.records.append(
                Record(position, kind.body, payload, self.last, self.boot, flags == "odd")
            )
            position, in_step = position + size, True
        self.found.tail = skipped
        return self.found

    def _judge(self, position: int, in_step: bool) -> tuple[str, str]:
        end = self._end(position)
        if end is None or not self._counts(end, in_step):
            return "damage", ""
        number = self.data[position + 2]
        if self.kinds[number].timed:
            return self._time(position, end)
        if number == 128 and not self._define(position):
            return "damage", ""
        return ("old" if self.old_from is not None else "good"), ""

    def _end(self, position: int) -> int | None:
        head = self.data[position : position + 3]
        kind = self.kinds.get(head[2]) if head[:2] == MAGIC and len(head) == 3 else None
        if kind is None or position + kind.length > len(self.data):
            return None
        return position + kind.length

    def _counts(self, end: int, in_step: bool) -> bool:
        rest = self.data[end : end + FILLER]
        if rest[:2] == MAGIC or not rest:
            return True
        if in_step and len(rest) >= 2:
            wrong = [(a ^ b).bit_count() for a, b in zip(rest, MAGIC, strict=False)]
            if sum(wrong) <= 1:
                return True
        run = len(rest) - len(rest.lstrip(rest[:1]))
        if end + run == len(self.data) and run < FILLER:
            return True
        if not in_step:
            return False
        if rest[0] == 0 and run >= 8 and (self.data[end - 1] != 0 or end % 200 == 0):
            return True
        return end % 512 == 0

    def _time(self, position: int, end: int) -> tuple[str, str]:
        (time_us,) = struct.unpack_from("<q", self.data, position + 3)
        how = self._how(time_us, end)
        if how == "odd":
            self.found.odd_times += 1
            return ("good" if self.old_from is None else "old"), "odd"
        if how == "back" and not self.marked:
            if self.old_from is None:
                self.old_from = position
            if position - self.old_from < CLUSTER:
                return "old", ""
            self.found.rewinds += 1
        elif how in ("ahead", "back") and self.last >= 0:
            self.boot += self.marked
            self.found.jumps += not self.marked and time_us > self.last + MINUTE_US
        self.last, self.marked, self.old_from = time_us, False, None
        return "good", ""

    def _how(self, time_us: int, place: int) -> str:
        last = self.last
        if last >= 0 and abs(time_us - last) <= STEP_US:
            return "near"
        if not 0 <= time_us < 1 << 52:
            return "odd"
        before, agreed = time_us, 0
        for _ in range(16):
            if place + 3 > len(self.data):
                agreed += last < 0 or 0 < time_us - last <= MINUTE_US
                break
            end = self._end(place)
            if end is None:
                break
            if self.kinds[self.data[place + 2]].timed:
                (following,) = struct.unpack_from("<q", self.data, place + 3)
                if following < before - STEP_US:
                    return "odd"
                if agreed == 0 and time_us < last and -STEP_US <= following - last <= MINUTE_US:
                    return "odd"
                before, agreed = following, agreed + 1
                if agreed == 2:
                    break
            place = end
        if agreed == 0:
            return "odd"
        return "ahead" if time_us > last else "back"

    def _define(self, position: int) -> bool:
        body = self.data[position + 3 : position + 89]
        number, length = body[0], body[1]
        if number == 128 and self.last >= 0:
            self.marked, self.epoch = True, self.epoch + 1
        name, letters, columns = (_text(part) for part in (body[2:6], body[6:22], body[22:]))
        if not name or not columns or letters is None or any(c not in SIZES for c in letters):
            return False
        told = 3 + sum(SIZES[c] for c in letters)
        if length <= 3 or told == 3:
            return False
        if number == 128 and told == length:
            return True
        known = self.kinds.get(number)
        if told != length:  # it defines nothing
            return known is None
        if known is not None and known.body == body:
            return True
        if (known is not None and known.epoch == self.epoch) or self.definitions == DEFINITIONS:
            return False
        self.definitions += 1
        timed = letters[:1] == "Q" and columns.split(",")[0] == "TimeUS"
        self.kinds[number] = Kind(body, length, timed, self.epoch)
        return True


def _text(part: bytes) -> str | None:
    """Return printable text padded with zeros; None of anything else."""
    text = part.split(b"\0")[0]
    if part[len(text) :].strip(b"\0") or any(not 0x20 <= byte < 0x7F for byte in text):
        return None
    return text.decode("ascii")


def scan(data: bytes) -> Scan:
    """Return every record of a stream, and what lies between them."""
    return _Scanner(data).scan()
