"""The log formats: the one list that recognition, the importer and the page read. It imports nothing heavy.

A new format is a package of its own, which is imported with the first such log, and a line in `FORMATS`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from typing import Final

__all__ = ["FORMATS", "MAVLINK", "SIGNATURES", "SUFFIXES", "Format", "format_of", "is_format_certain"]


@dataclass(frozen=True, slots=True)
class Format:
    """A log format.

    Attributes
    ----------
    name
        Name in inspections and assessments.
    title
        Name in error messages: "this is …".
    suffixes
        Suffixes of its files, in small letters.
    package
        Package of its decoder.
    signature
        The first bytes of every such log; empty if it has none.
    clue
        What occurs several times near the beginning, by which a log with damaged first bytes is recognised.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    package: str
    signature: bytes
    clue: re.Pattern[bytes]


MAVLINK: Final = Format(
    "tlog",
    "a MAVLink telemetry log (.tlog)",
    (".tlog",),
    "mavhums.log.mavlink",
    b"",
    re.compile(rb"(?!)"),
)
"""The format without a signature: what no other format claims."""

FORMATS: Final = (
    MAVLINK,
    Format(
        "dataflash",
        "an ArduPilot DataFlash log (.BIN)",
        (".bin",),
        "mavhums.log.dataflash",
        b"\xa3\x95",
        re.compile(rb"\xa3\x95\x80(?=.{86}\xa3\x95\x80)", re.DOTALL),  # a definition directly after another
    ),
    Format(
        "ulog",
        "a PX4 ULog (.ulg)",
        (".ulg",),
        "mavhums.log.ulog",
        b"ULog\x01\x12\x35",
        re.compile(rb"\w:uint64_t timestamp;"),  # the definition of a topic
    ),
)
_SIGNED: Final = tuple(known for known in FORMATS if known.signature)

SUFFIXES: Final = tuple(suffix for known in FORMATS for suffix in known.suffixes)
SIGNATURES: Final = tuple(known.signature for known in _SIGNED)

_CLUES: Final = 3
_SEARCHED: Final = 1 << 16
_FRAME_AT: Final = (0, 8)  # a MAVLink frame comes first, or after a time stamp
_FRAME: Final = (0xFD, 0xFE)
_LONGEST: Final = max(*_FRAME_AT, *map(len, SIGNATURES)) + 1


def format_of(head: bytes) -> Format:
    """Return the format of a log that begins with ``head``; `MAVLINK` for what no other format claims.

    If the log begins neither with a signature nor with a MAVLink frame, its first 64 KB are searched.

    Examples
    --------
    >>> format_of(b"\\xa3\\x95\\x80\\x80").name
    'dataflash'
    """
    signed = _signed(head)
    if signed is not None or _begins_with_frame(head):
        return signed or MAVLINK
    searched = head[:_SEARCHED]
    clues = ((known, sum(1 for _ in islice(known.clue.finditer(searched), _CLUES))) for known in _SIGNED)
    return next((known for known, count in clues if count == _CLUES), MAVLINK)


def is_format_certain(head: bytes) -> bool:
    """Return whether later bytes do not change the format."""
    found = _signed(head) is not None or _begins_with_frame(head)
    return len(head) >= _LONGEST and (len(head) >= _SEARCHED or found)


def _signed(head: bytes) -> Format | None:
    return next((known for known in _SIGNED if head.startswith(known.signature)), None)


def _begins_with_frame(head: bytes) -> bool:
    return any(len(head) > at and head[at] in _FRAME for at in _FRAME_AT)
