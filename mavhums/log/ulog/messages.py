"""Parses the messages of a ULog other than data to rows of tables."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from mavhums.log.ulog.layouts import BASIC

__all__ = ["READERS", "RESERVED", "FlagBits", "flag_bits", "parameter"]

TEXT_BYTES: Final = 255
PARAMETER: Final = np.dtype([("name", "S64"), ("type", "S16"), ("value", "<f8")])
STRING: Final = np.dtype([("timestamp", "<u8"), ("level", "u1"), ("tag", "<u2"), ("text", f"S{TEXT_BYTES}")])
INFO: Final = np.dtype([("name", "S64"), ("type", "S16"), ("value", f"S{TEXT_BYTES}")])
DROPOUT: Final = np.dtype([("duration_ms", "<u2")])

Row = tuple[object, ...]


class FlagBits(NamedTuple):
    """The log's first message: whether the log can be read, and where data was appended later."""

    incompatible: bool
    appended: tuple[int, ...]


class _Reader(NamedTuple):
    """The table of a message kind, and its parser."""

    table: str
    wire: np.dtype[np.void]
    read: Callable[[bytes], Row | None]


def flag_bits(body: bytes) -> FlagBits:
    """Parse a flag-bits message of at least 40 bytes.

    Examples
    --------
    >>> flag_bits(bytes(8) + b"\\x01" + bytes(7) + (500).to_bytes(8, "little") + bytes(16))
    FlagBits(incompatible=False, appended=(500,))
    """
    unknown = body[8] & 0xFE or any(body[9:16])
    offsets = struct.unpack("<3Q", body[16:40]) if body[8] & 1 else ()
    return FlagBits(bool(unknown), tuple(sorted(offset for offset in offsets if offset)))


def parameter(body: bytes) -> tuple[bytes, bytes, float] | None:
    """Return name, type and value of a parameter; None if the message is invalid."""
    kind, name, value = _keyed(body)
    if kind not in (b"int32_t", b"float") or len(value) != 4:
        return None
    return name, kind, float(np.frombuffer(value, dtype=BASIC[kind.decode()])[0])


def _info(body: bytes) -> Row | None:
    kind, name, value = _keyed(body)
    if not kind.startswith(b"char["):
        form = np.dtype(BASIC.get(kind.decode("ascii", "replace"), "S1"))
        if form.kind == "S" or len(value) != form.itemsize:
            return None
        value = str(np.frombuffer(value, dtype=form)[0]).encode()
    return name, kind, value[:TEXT_BYTES]


def _string(body: bytes) -> Row:
    return int.from_bytes(body[1:9], "little"), body[0] - 48, 0, body[9 : 9 + TEXT_BYTES]


def _tagged_string(body: bytes) -> Row:
    tag, time_us = struct.unpack("<HQ", body[1:11])
    return time_us, body[0] - 48, tag, body[11 : 11 + TEXT_BYTES]


def _dropout(body: bytes) -> Row:
    return (int.from_bytes(body, "little"),)


def _keyed(body: bytes) -> tuple[bytes, bytes, bytes]:
    """Return type, name and value of a message ``length type name value``."""
    end = 1 + body[0]
    kind, _, name = body[1:end].partition(b" ")
    return kind, name, body[end:]


READERS: Final = {
    ord("P"): _Reader("parameter", PARAMETER, parameter),
    ord("I"): _Reader("info", INFO, _info),
    ord("L"): _Reader("logged_string", STRING, _string),
    ord("C"): _Reader("logged_string", STRING, _tagged_string),
    ord("O"): _Reader("dropout", DROPOUT, _dropout),
}
"""By kind. Defaults of parameters (Q), and information in many parts (M), are passed over."""

RESERVED: Final = frozenset(reader.table for reader in READERS.values())
