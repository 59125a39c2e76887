"""The layout of records, and the definitions in FMT records.

A record is ``A3 95``, a type and a payload without padding, little-endian. Its length is defined only
by the FMT record of its type, which itself has type 128: type, length of the whole record, name
(4 characters), a letter for each field (16), and their names, separated by commas (64).

Across types times step back by less than a millisecond. A time more than a tenth of a second from the one
before counts as a step only if the next records continue from there; otherwise the stamp is damaged.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mavhums.core.arrays import Bytes, Records
from mavhums.core.kernels import inlined, load_word, subroutine
from mavhums.log.base.records import Definition, DefinitionTable
from mavhums.log.base.scanner import WAIT, plausible

MAGIC_1, MAGIC_2 = 0xA3, 0x95
HEAD = 3
FMT, FMT_SIZE = 128, 89
BODY = FMT_SIZE - HEAD
DEFINITIONS = 1024
"""Most definitions that one log may hold; more are taken for damage."""

_TYPES = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "d": "<f8", "g": "<f2", "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4",
    "E": "<u4", "L": "<i4", "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
"""Numpy's type of a field by its letter."""
_DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}

TYPE = np.dtype([("length", "i4"), ("epoch", "i4"), ("definition", "i2"), ("timed", "u1")])
"""What is known of a type: bytes of a record, 0 if unknown; since which beginning of a log; the number of
its definition; and whether its records begin with TimeUS."""

IN_ORDER, AHEAD, BACK, ODD = 1, 2, 3, 4
"""A time near the one before, a step forward, a step back, and a damaged stamp."""

_TOLERANCE_US = 100_000
GAP_US = 60 * 1_000_000
_CONFIRM = 2
_LOOKED_AT = 16

_SIZE_OF = np.zeros(256, dtype=np.uint8)
for _letter, _type in _TYPES.items():
    _SIZE_OF[ord(_letter)] = np.dtype(_type).itemsize
_TIME = np.frombuffer(b"TimeUS", dtype=np.uint8)
_NAME, _FORMAT, _COLUMNS = HEAD + 2, HEAD + 6, HEAD + 22


@inlined
def begins(data: Bytes, place: int) -> bool:
    """Return whether ``place`` holds a record's two magic bytes."""
    return bool(data[place] == MAGIC_1 and data[place + 1] == MAGIC_2)


@subroutine
def _is_text(data: Bytes, start: int, end: int) -> bool:
    """Return whether these bytes are printable text, with zeros only at its end."""
    length = 0
    while start + length < end and data[start + length] != 0:
        if not 0x20 <= data[start + length] < 0x7F:
            return False
        length += 1
    for place in range(start + length, end):
        if data[place] != 0:
            return False
    return length > 0


@subroutine
def _record_size(data: Bytes, start: int, end: int) -> int:
    """Return the size of a record with these fields, bytes; 0 if a field type does not exist."""
    size = HEAD
    place = start
    while place < end and data[place] != 0:
        if _SIZE_OF[data[place]] == 0:
            return 0
        size += _SIZE_OF[data[place]]
        place += 1
    while place < end:
        if data[place] != 0:
            return 0
        place += 1
    return size


@subroutine
def _is_timed(data: Bytes, position: int) -> bool:
    if data[position + _FORMAT] != ord("Q"):
        return False
    for k in range(_TIME.size):
        if data[position + _COLUMNS + k] != _TIME[k]:
            return False
    after = data[position + _COLUMNS + _TIME.size]
    return bool(after == 0) or bool(after == ord(","))


@subroutine
def define(data: Bytes, position: int, epoch: int, types: Records, bodies: Bytes, known: int) -> int:
    """Process a FMT record, and return the number of definitions, or -1 if it is damaged.

    A type keeps its definition until another log begins; an earlier contradiction is damage.

    Parameters
    ----------
    epoch
        Number of logs that have begun.
    types, bodies
        By type, `TYPE` of shape (256,), and by definition, shape (``DEFINITIONS``, ``BODY``); updated.
    known
        Number of definitions so far.
    """
    length = int(data[position + HEAD + 1])
    if not _is_text(data, position + _NAME, position + _FORMAT):
        return -1
    if not _is_text(data, position + _COLUMNS, position + FMT_SIZE):
        return -1
    size = _record_size(data, position + _FORMAT, position + _COLUMNS)
    if length <= HEAD or size == 0:
        return -1
    number = int(data[position + HEAD])
    if number == FMT and size == length:
        return known
    kind = types[number]
    # Firmware defines messages that it never writes with a length of its own (ArduCopter 3.4: EKF5, BAR3).
    # Such a definition defines nothing; a record of its kind, if one comes, is damage.
    if size != length:
        return known if kind.length == 0 else -1
    if kind.length > 0:
        same = True
        for k in range(BODY):
            same &= data[position + HEAD + k] == bodies[kind.definition, k]
        if same:
            return known
        if kind.epoch == epoch:
            return -1
    if known == DEFINITIONS:
        return -1
    for k in range(BODY):
        bodies[known, k] = data[position + HEAD + k]
    kind.length = length
    kind.epoch = epoch
    kind.definition = known
    kind.timed = _is_timed(data, position)
    return known + 1


@inlined
def time_at(data: Bytes, position: int) -> int:
    """Return TimeUS of the record at ``position``."""
    return int(np.int64(load_word(data, position + HEAD)))


@subroutine
def _confirm(data: Bytes, place: int, time_us: int, last: int, types: Records, final: bool) -> int:
    """Judge a time by the times of the records from ``place`` on."""
    before, agreed = time_us, 0
    for _ in range(_LOOKED_AT):
        if place + HEAD > data.size:
            if not final:
                return WAIT
            agreed += last < 0 or 0 < time_us - last <= GAP_US
            break
        length = int(types[data[place + 2]].length)
        if not begins(data, place) or length == 0:
            break
        if place + length > data.size:
            if not final:
                return WAIT
            break
        if types[data[place + 2]].timed:
            following = time_at(data, place)
            if following < before - _TOLERANCE_US:
                return ODD
            if agreed == 0 and time_us < last and -_TOLERANCE_US <= following - last <= GAP_US:
                return ODD
            before = following
            agreed += 1
            if agreed == _CONFIRM:
                break
        place += length
    if agreed == 0:
        return ODD
    return AHEAD if time_us > last else BACK


@inlined
def is_near(time_us: int, last: int) -> bool:
    """Return whether a time is in order after ``last``."""
    return bool(-_TOLERANCE_US <= time_us - last <= _TOLERANCE_US)


@inlined
def judge_time(data: Bytes, end: int, time_us: int, last: int, types: Records, final: bool) -> int:
    """Compare the time of a record that ends at ``end`` with ``last``, -1 if there is none."""
    if last >= 0 and is_near(time_us, last):
        return IN_ORDER
    if not plausible(time_us):
        return ODD
    return _confirm(data, end, time_us, last, types, final)


FMT_BODY = bytes([FMT, FMT_SIZE]) + b"FMT\0" + b"BBnNZ".ljust(16, b"\0")
FMT_BODY += b"Type,Length,Name,Format,Columns".ljust(64, b"\0")
"""The definition that every log has from its beginning: that of definitions."""


@lru_cache(maxsize=4096)
def definition_of(raw: bytes) -> Definition | None:
    """Return the definition in the payload of a FMT record; None if its fields lack distinct names.

    Logs of one firmware have the same two hundred definitions, and a stream of logs repeats them.

    Examples
    --------
    >>> definition_of(FMT_BODY).wire["Columns"].str
    '|S64'
    """
    name, letters, columns = (
        part.split(b"\0")[0].decode("ascii") for part in (raw[2:6], raw[6:22], raw[22:BODY])
    )
    fields = columns.split(",")
    if len(fields) != len(letters) or len(set(fields)) != len(fields) or "" in fields:
        return None
    wire = np.dtype([(field, _TYPES[letter]) for field, letter in zip(fields, letters, strict=True)])
    divisors = {
        f: _DIVISORS[letter] for f, letter in zip(fields, letters, strict=True) if letter in _DIVISORS
    }
    return Definition(name, wire, divisors)


class RecordDefinitions(DefinitionTable):
    """The definitions of a log, in the order of their FMT records.

    A definition without names for its fields, or whose name already has another layout, cannot be used.

    Attributes
    ----------
    numbers
        Number of the type that each one defines.
    """

    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[int] = []
        self._by_name: dict[str, Definition] = {}

    def learn(self, bodies: Bytes) -> None:
        """Add the new definitions in ``bodies``, the payloads of the FMT records so far."""
        for body in bodies[len(self) :]:
            definition = definition_of(body.tobytes())
            self.numbers.append(int(body[0]))
            usable = definition and self._by_name.setdefault(definition.name, definition) == definition
            self.add(definition if usable else None)
