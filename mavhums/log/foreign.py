"""Recognises files that are not telemetry logs, and gives the remedy."""

from __future__ import annotations

import os
import re

from mavhums.core.errors import UnreadableLogError
from mavhums.log.decoding import format_of
from mavhums.log.mavlink.decoder import MavlinkDecoder

__all__ = ["refuse_foreign"]

_SIGNATURES = (
    (b"RRF2", "a Rerun recording"),
    (b"\x1f\x8b", "gzip-compressed"),
    (b"PK\x03\x04", "a zip archive"),
)
_PIECE = 1 << 16
_DUMP = re.compile(rb"\s*FMT, *128, *89,")
_PROFILE = re.compile(rb"^\s*\[\[ *actuators *\]\]", re.MULTILINE)
_RECORD = "mavhums reads MAVLink telemetry logs (.tlog); record one with the ground station, or with MAVProxy"


def refuse_foreign(name: str, head: bytes, *, dialect: str | os.PathLike[str] | None = None) -> None:
    """Raise if a file that begins with ``head`` is not a telemetry log.

    Raises
    ------
    UnreadableLogError
        If it is not; the error names the probable file type and the remedy.
    """
    if not head:
        raise UnreadableLogError(
            f"{name}: the file is empty", "check that the ground station had closed the log"
        )
    if not head.strip(b"\0"):
        raise UnreadableLogError(f"{name}: the file holds nothing but zeros", "copy the log again")
    known = format_of(head)
    if known is not None:
        refused = known.load().refusal(head)
        if refused is not None:
            raise UnreadableLogError(f"{name}: {refused.problem}", refused.remedy)
        if dialect is not None:
            problem = f"{name}: this is {known.title}: a dialect is for MAVLink logs alone"
            raise UnreadableLogError(problem, "leave --dialect out")
        return
    if _holds_frames(head, dialect):
        return
    for signature, kind in _SIGNATURES:
        if head.startswith(signature):
            remedy = "unpack it first" if "compressed" in kind or "archive" in kind else _RECORD
            raise UnreadableLogError(f"{name}: this is {kind}, not a MAVLink telemetry log", remedy)
    if _DUMP.match(head):
        raise UnreadableLogError(
            f"{name}: this is a DataFlash log dumped as text", "download the .BIN itself from the autopilot"
        )
    if _PROFILE.search(head):
        problem = f"{name}: this is an airframe profile, not a log"
        raise UnreadableLogError(problem, "name it with --airframe, and the log in its place")
    if _is_text(head):
        raise UnreadableLogError(f"{name}: this is a text file, not a MAVLink telemetry log", _RECORD)
    raise UnreadableLogError(f"{name}: no MAVLink frame found in the first {len(head)} bytes", _RECORD)


def _holds_frames(data: bytes, dialect: str | os.PathLike[str] | None) -> bool:
    decoder = MavlinkDecoder((), dialect=dialect)
    # The first frame settles it, usually in the first piece.
    for place in range(0, len(data), _PIECE):
        decoder.feed(data[place : place + _PIECE], final=place + _PIECE >= len(data))
        if decoder.counts or decoder.unknown:
            return True
    return False


def _is_text(head: bytes) -> bool:
    try:
        text = head[: len(head) - 4].decode("utf-8")
    except UnicodeDecodeError:
        return False
    return all(character.isprintable() or character.isspace() for character in text)
