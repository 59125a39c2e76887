"""The meaning of message ids: a log's subscriptions, and the record layouts that its formats define.

Nested types are flattened, padding is omitted.

A format is ``name:type field;type[n] field;…``; a type is a basic one or the name of another format.
The log contains the padding within a record, but not that at its end.

A message is its size (u16) without these three bytes, its kind (one letter) and its body. ULog has no
checksum; a message is distinguished from other bytes by its kind, the size of this kind, and the
header that follows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mavhums.core.arrays import Bytes, Records
from mavhums.core.kernels import inlined, subroutine
from mavhums.log.base.decoder import C_NUMBERS
from mavhums.log.base.scanner import NO, WAIT, YES

UNUSED, UNKNOWN = -1, -2

TOPIC = np.dtype(
    [
        (name, "i4")
        for name in ("definition", "least", "most", "stamp", "instance", "timed", "unknown", "spare")
    ]
)
"""The messages that an id denotes.

``definition`` is the number of a record's layout, ``UNUSED``, or ``UNKNOWN`` of an id whose layout is
not known; ``least`` and ``most`` bound the bytes of a record, ``stamp`` is where its time stamp lies,
-1 where it has none, ``instance`` the multi id. ``timed`` is whether a record of it had a sound time,
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


BASIC: Final = C_NUMBERS | {"bool": "u1", "char": "S1"}
_NAME = r"[A-Za-z_][A-Za-z0-9_\-/]*"
_FORMAT = re.compile(rf"({_NAME}):(.*)", re.DOTALL)
_FIELD = re.compile(rf"({_NAME})(?:\[(\d{{1,5}})\])? +([A-Za-z_][A-Za-z0-9_\-/.]*)")
_LARGEST = 65_533
_MOST_FIELDS = 4096
_MOST_FORMATS = 4096
_MOST_STEPS = 1_000_000
_IDS = 1 << 16
_TOPIC = re.compile(r"[A-Za-z][A-Za-z0-9_\-/]{0,254}")
_OF_OTHERS = re.compile("[A-Z0-9_]+")
"""Names as of MAVLink messages and DataFlash records: what reads those must not take a topic for one."""

_RESERVED = frozenset({"parameter", "info", "logged_string", "dropout"})
"""Tables of messages other than data, whose names no topic may take."""


class _NoLayoutError(ValueError):
    """The formats do not define the layout."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of a topic's records.

    Attributes
    ----------
    name
        Name of the topic.
    wire
        Record type, little endian without gaps except padding; a nested type's fields are named
        ``esc[0].esc_rpm``, an array of numbers is one field, chars are text.
    most
        Size of a record including the padding at its end, bytes.
    stamp
        Offset of the field ``timestamp``, a u64; -1 if there is none.
    """

    name: str
    wire: np.dtype[np.void]
    most: int
    stamp: int

    def has(self, field: str, form: str) -> bool:
        """Return whether a record has a field of this type."""
        return field in (self.wire.names or ()) and self.wire[field] == np.dtype(form)


@dataclass(slots=True)
class _FieldLayout:
    """A field of a record."""

    name: str
    form: str
    count: int | None
    offset: int


class Formats:
    """The formats that a log defines; a damaged log may define any number of them.

    Examples
    --------
    >>> formats = Formats()
    >>> formats.add(b"airspeed:uint64_t timestamp;float true_airspeed_m_s;uint8_t[4] _padding0;")
    >>> layout = formats.layout("airspeed")
    >>> layout.wire.itemsize, layout.most, layout.stamp
    (12, 16, 0)
    """

    def __init__(self) -> None:
        self._fields: dict[str, list[tuple[str, int | None, str]]] = {}
        self._layouts: dict[str, Layout | None] = {}
        self._steps = 0

    def add(self, body: bytes) -> None:
        """Add a format message; an invalid one, or one that contradicts a format in use, is ignored."""
        text = body.decode("utf-8", "replace")
        match = _FORMAT.fullmatch(text)
        if match is None:
            return
        fields = [_FIELD.fullmatch(field.strip()) for field in match[2].split(";") if field.strip()]
        known = [(m[1], int(m[2]) if m[2] else None, m[3]) for m in fields if m]
        name = match[1]
        if len(known) < len(fields) or self._layouts.get(name) is not None:
            return
        if len(self._fields) < _MOST_FORMATS or name in self._fields:
            self._fields[name] = known
            self._layouts = {used: layout for used, layout in self._layouts.items() if layout}

    def layout(self, name: str) -> Layout | None:
        """Return the layout of a topic's records; None if the formats do not define it."""
        if name not in self._layouts:
            try:
                self._layouts[name] = self._lay_out(name)
            except _NoLayoutError:
                self._layouts[name] = None
        return self._layouts[name]

    def _lay_out(self, name: str) -> Layout:
        parts: list[_FieldLayout] = []
        most = self._expand(name, "", 0, (), parts)
        least = most
        while parts and parts[-1].name.startswith("_padding"):
            least = parts.pop().offset
        kept = [part for part in parts if not part.name.rpartition(".")[2].startswith("_padding")]
        names = [part.name for part in kept]
        if not kept or len(set(names)) < len(names):
            raise _NoLayoutError
        stamps = [part.offset for part in kept if (part.name, part.form) == ("timestamp", "<u8")]
        wire = np.dtype(
            {
                "names": names,
                "formats": [_form(part) for part in kept],
                "offsets": [part.offset for part in kept],
                "itemsize": least,
            }
        )
        return Layout(name, wire, most, stamps[0] if stamps else -1)

    def _expand(
        self, name: str, prefix: str, at: int, within: tuple[str, ...], parts: list[_FieldLayout]
    ) -> int:
        """Append the fields of a format from byte ``at`` on; return their end."""
        if name not in self._fields or name in within:
            raise _NoLayoutError
        for kind, count, field in self._fields[name]:
            self._steps += 1
            if self._steps > _MOST_STEPS or len(parts) > _MOST_FIELDS or count == 0:
                raise _NoLayoutError
            if kind in BASIC:
                parts.append(_FieldLayout(prefix + field, BASIC[kind], count, at))
                at += np.dtype(BASIC[kind]).itemsize * (1 if count is None else count)
            elif count is None:
                at = self._expand(kind, f"{prefix}{field}.", at, (*within, name), parts)
            else:
                for k in range(count):
                    at = self._expand(kind, f"{prefix}{field}[{k}].", at, (*within, name), parts)
            if at > _LARGEST:
                raise _NoLayoutError
        return at


def _form(part: _FieldLayout) -> object:
    """Return a field's numpy type."""
    if part.form == "S1":
        return f"S{part.count or 1}"
    return part.form if part.count is None else (part.form, (part.count,))


class Topics:
    """Tracks formats and subscriptions.

    Attributes
    ----------
    ids
        Shape (65536,) of `TOPIC`, by message id, for the scan kernel.
    layouts
        Layouts of the subscribed topics, one for each name.
    """

    def __init__(self) -> None:
        self.ids: Records = np.zeros(_IDS, dtype=TOPIC)
        self.ids["definition"] = UNUSED
        self.layouts: list[Layout] = []
        self._formats = Formats()
        self._numbers: dict[str, int] = {}

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records by message id that have no layout."""
        counts = self.ids["unknown"]
        return {int(number): int(counts[number]) for number in np.flatnonzero(counts)}

    def observe(self, kind: int, body: bytes) -> None:
        """Process a format, a subscription, or its end."""
        if kind == _F:
            self._formats.add(body)
        elif kind == _A:
            self._subscribe(body[0], int.from_bytes(body[1:3], "little"), body[3:].decode("utf-8", "replace"))
        elif kind == _R:
            self.ids[int.from_bytes(body[:2], "little")]["definition"] = UNKNOWN

    def _subscribe(self, instance: int, number: int, name: str) -> None:
        layout = self._formats.layout(name) if _TOPIC.fullmatch(name) and name not in _RESERVED else None
        topic = self.ids[number]
        topic["instance"] = instance
        if layout is None:
            topic["definition"], topic["least"], topic["most"] = UNKNOWN, 0, _IDS
            return
        if _OF_OTHERS.fullmatch(name):
            name = f"ulog_{name}"
            layout = replace(layout, name=name)
        if name not in self._numbers:
            self._numbers[name] = len(self.layouts)
            self.layouts.append(layout)
        topic["definition"] = self._numbers[name]
        topic["least"], topic["most"], topic["stamp"] = layout.wire.itemsize, layout.most, layout.stamp
