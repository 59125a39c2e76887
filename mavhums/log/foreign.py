"""Recognise files that are not telemetry logs, and say what to do with them."""

from __future__ import annotations

import os

from mavhums.core.errors import UnreadableLogError
from mavhums.log.mavlink.decoder import Decoder

__all__ = ["refuse_foreign"]

_SIGNATURES = (
    (b"\xa3\x95", "an ArduPilot DataFlash log (.BIN)"),
    (b"ULog\x01\x12\x35", "a PX4 ULog (.ulg)"),
    (b"RRF2", "a Rerun recording"),
    (b"\x1f\x8b", "gzip-compressed"),
    (b"PK\x03\x04", "a zip archive"),
)
_RECORD = "mavhums reads MAVLink telemetry logs (.tlog); record one with the ground station, or with MAVProxy"


def refuse_foreign(name: str, head: bytes, *, dialect: str | os.PathLike[str] | None = None) -> None:
    """Raise if a file that begins with ``head`` is not a telemetry log.

    Raises
    ------
    UnreadableLogError
        Naming what the file seems to be, and the remedy.
    """
    if not head:
        raise UnreadableLogError(
            f"{name}: the file is empty", "check that the ground station had closed the log"
        )
    if _holds_frames(head, dialect):
        return
    for signature, kind in _SIGNATURES:
        if head.startswith(signature):
            remedy = "unpack it first" if "compressed" in kind or "archive" in kind else _RECORD
            raise UnreadableLogError(f"{name}: this is {kind}, not a MAVLink telemetry log", remedy)
    if _is_text(head):
        raise UnreadableLogError(f"{name}: this is a text file, not a MAVLink telemetry log", _RECORD)
    raise UnreadableLogError(f"{name}: no MAVLink frame found in the first {len(head)} bytes", _RECORD)


def _holds_frames(data: bytes, dialect: str | os.PathLike[str] | None) -> bool:
    decoder = Decoder((), dialect=dialect)
    decoder.feed(data, final=True)
    return bool(decoder.counts or decoder.unknown)


def _is_text(head: bytes) -> bool:
    try:
        text = head[: len(head) - 4].decode("utf-8")
    except UnicodeDecodeError:
        return False
    return all(character.isprintable() or character.isspace() for character in text)
