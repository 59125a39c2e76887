"""The meaning of message ids: a log's subscriptions, and the record layouts that its formats define.

Nested types are flattened, padding is omitted.

A format is ``name:type field;type[n] field;…``; a type is a basic one or the name of another format.
The log contains the padding within a record, but not that at its end.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mavhums.core.arrays import Records
from mavhums.log.base.tables import C_NUMBERS
from mavhums.log.ulog.headers import TOPIC, UNKNOWN, UNUSED

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

_F, _A, _R = b"FAR"
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
