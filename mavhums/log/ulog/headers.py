"""Checks whether a ULog message begins at a position of a buffer.

A message is its size (u16) without these three bytes, its kind (one letter) and its body. ULog has no
checksum; a message is distinguished from other bytes by its kind, the size of this kind, and the
header that follows.
"""

from __future__ import annotations

import numpy as np

from mavhums.core.arrays import Bytes, Records
from mavhums.core.kernels import inlined, subroutine
from mavhums.log.base.scanner import NO, WAIT, YES

UNUSED, UNKNOWN = -1, -2

TOPIC = np.dtype(
    [
        (name, "i4")
        for name in ("definition", "least", "most", "stamp", "instance", "timed", "unknown", "spare")
    ]
)
"""What a message id stands for.

``definition`` is the number of a record's layout, ``UNUSED``, or ``UNKNOWN`` of an id whose layout is
not known; ``least`` and ``most`` bound the bytes of a record, ``stamp`` is where its time stamp lies,
-1 where it has none, ``instance`` the multi id. ``timed`` tells whether a record of it had a sound time,
``unknown`` counts the records without a layout.
"""

BODY = 3

_A, _B, _C, _D, _F, _I, _L, _M, _O, _P, _Q, _R, _S = (ord(c) for c in "ABCDFILMOPQRS")
_SYNC = np.frombuffer(b"\x2f\x73\x13\x20\x25\x0c\xbb\x12", dtype=np.uint8)
_TYPES = np.frombuffer(b"inuifldoboch", dtype=np.uint8)
_LONGEST_NAME = 255
_LONGEST_TEXT = 2048


@inlined
def size_of(data: Bytes, place: int) -> int:
    """Return the body size in the header at ``place``."""
    return int(np.int64(data[place]) | np.int64(data[place + 1]) << 8)


@inlined
def kind_of(data: Bytes, place: int) -> int:
    """Return the kind of the message whose header is at ``place``."""
    return int(np.int64(data[place + 2]))


@inlined
def topic_of(data: Bytes, place: int) -> int:
    """Return the message id of the data message at ``place``."""
    return int(np.int64(data[place + BODY]) | np.int64(data[place + BODY + 1]) << 8)


@inlined
def _is_letter(byte: int) -> bool:
    """Return whether a byte is a valid character of a name."""
    return 97 <= byte <= 122 or 65 <= byte <= 90 or byte == 95


@inlined
def _cut(final: bool) -> int:
    """Return the result for a header cut by the end of the buffer: at the end of a log it may be valid."""
    return YES if final else WAIT


@subroutine
def header_fits(data: Bytes, place: int, final: bool, topics: Records) -> int:
    """Return whether a message of a known kind with a valid size begins at ``place``."""
    if place + BODY > data.size:
        return _cut(final)
    size, kind = size_of(data, place), kind_of(data, place)
    if kind == _D:
        if place + BODY + 2 > data.size:
            return _cut(final) if size >= 2 else NO
        topic = topics[topic_of(data, place)]
        known = topic.definition != UNUSED
        return YES if known and topic.least <= size - 2 <= topic.most else NO
    if kind in (_O, _R):
        return YES if size == 2 else NO
    if kind == _S:
        return _is_sync(data, place + BODY) if size == _SYNC.size else NO
    if kind in (_L, _C):
        return _level_at(data, place + BODY, final) if size >= (9 if kind == _L else 11) else NO
    if kind in (_F, _A):
        before = 0 if kind == _F else 3
        longest = _LONGEST_NAME + 3 if kind == _A else 0xFFFF
        return _letter_at(data, place + BODY + before, final) if before < size <= longest else NO
    if kind in (_I, _P, _M, _Q):
        return _keyed_at(data, place + BODY, size, 0 if kind in (_I, _P) else 1, final)
    return NO


@inlined
def _is_sync(data: Bytes, place: int) -> int:
    for k in range(min(_SYNC.size, data.size - place)):
        if data[place + k] != _SYNC[k]:
            return NO
    return YES


@inlined
def _level_at(data: Bytes, place: int, final: bool) -> int:
    if place >= data.size:
        return _cut(final)
    return YES if 48 <= data[place] <= 55 else NO


@inlined
def _keyed_at(data: Bytes, place: int, size: int, before: int, final: bool) -> int:
    """Return whether the length of a key fits at ``place + before``, and a basic type's name follows."""
    if size < before + 2:
        return NO
    if place + before >= data.size:
        return _cut(final)
    length = np.int64(data[place + before])
    if length < 3 or length + before + 1 > size:
        return NO
    first = place + before + 1
    if first + 1 >= data.size:
        return _cut(final)
    for k in range(_TYPES.size // 2):
        if data[first] == _TYPES[2 * k] and data[first + 1] == _TYPES[2 * k + 1]:
            return YES
    return NO


@inlined
def _letter_at(data: Bytes, place: int, final: bool) -> int:
    if place >= data.size:
        return _cut(final)
    return YES if _is_letter(data[place]) else NO


@inlined
def _is_text(data: Bytes, begin: int, end: int) -> bool:
    sound = True
    for k in range(begin, end):
        sound &= data[k] >= 32 or 9 <= data[k] <= 13
    return sound


@subroutine
def looks_sound(data: Bytes, place: int) -> bool:
    """Return whether the text parts of the complete message at ``place`` are text.

    This applies out of step, to kinds whose header alone cannot be distinguished from noise.
    """
    size, kind = size_of(data, place), kind_of(data, place)
    begin, end = place + BODY, place + BODY + size
    if kind in (_D, _S, _O, _R):
        return True
    if kind in (_L, _C):
        if size > _LONGEST_TEXT:
            return False
        begin += 9 if kind == _L else 11
    elif kind == _A:
        begin += 3
    elif kind != _F:
        begin += 1 if kind in (_M, _Q) else 0
        end = begin + 1 + int(data[begin])
        begin += 1
    return _is_text(data, begin, end)


@inlined
def _sound_at(data: Bytes, place: int, final: bool, topics: Records) -> int:
    if place > data.size:
        return NO if final else WAIT
    return header_fits(data, place, final, topics)


@subroutine
def landing(data: Bytes, place: int, final: bool, topics: Records) -> tuple[int, int]:
    """Return whether a message with a damaged header begins at ``place``, and its end.

    Two of the header's three parts (size, kind, message id) must agree, and a valid header must be
    at the message's end. An unknown kind agrees with any size.
    """
    if place + BODY > data.size:
        return (NO if final else WAIT), place
    size, kind = size_of(data, place), kind_of(data, place)
    end = place + BODY + size
    if 65 <= kind <= 90:
        sound = _sound_at(data, end, final, topics)
        if sound != NO:
            return sound, end
    if place + BODY + 2 > data.size:
        return (NO if final else WAIT), place
    topic = topics[topic_of(data, place)]
    if topic.definition < 0:
        return NO, place
    if topic.least <= size - 2 <= topic.most:
        return _sound_at(data, end, final, topics), end
    end = place + BODY + 2 + topic.least
    return (_sound_at(data, end, final, topics) if kind == _D else NO), end


@subroutine
def follows(data: Bytes, start: int, final: bool, topics: Records, strict: bool) -> int:
    """Return whether a message follows the one at ``start``.

    Unless ``strict`` it may be damaged in one part of its header.
    """
    place = start + BODY + size_of(data, start)
    fits = header_fits(data, place, final, topics)
    if fits != NO:
        return fits
    if kind_of(data, start) == _A and kind_of(data, place) == _D:
        if place + BODY + 2 > data.size:
            return NO if final else WAIT
        if data[place + BODY] == data[start + BODY + 1] and data[place + BODY + 1] == data[start + BODY + 2]:
            return YES
    return NO if strict else landing(data, place, final, topics)[0]
