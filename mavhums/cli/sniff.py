"""Distinguishes an aircraft's log from other files by its first bytes, before any heavy import."""

from __future__ import annotations

from typing import Final

from mavhums.log.formats import SIGNATURES

__all__ = ["HEAD", "is_log"]

HEAD: Final = 1 << 16
"""Bytes that are enough to tell."""

_STAMP: Final = 8
_CHAIN, _FEW = 6, 2
_OVERHEAD: Final = {0xFE: 8, 0xFD: 12}
_SIGNATURE: Final = 13


def is_log(head: bytes) -> bool:
    """Return whether a file that begins with ``head`` is a log that mavhums reads.

    It is a MAVLink telemetry log if six consecutive frames occur somewhere in it, all with a time
    stamp or all without, or if it consists of only a few frames. A damaged start does not matter. An
    on-board log begins with its signature.

    Examples
    --------
    >>> heartbeat = bytes(8) + b"\\xfe\\x09" + bytes(15)
    >>> is_log(6 * heartbeat), is_log(b"{}"), is_log(b"")
    (True, False, False)
    """
    return head.startswith(SIGNATURES) or any(_chained(head, stamp) for stamp in (_STAMP, 0))


def _chained(head: bytes, stamp: int) -> bool:
    lines: dict[
        int, tuple[int, int]
    ] = {}  # by offset of the next frame: number of frames so far, and the first offset
    for magic in range(stamp, len(head) - 2):
        overhead = _OVERHEAD.get(head[magic])
        if overhead is None:
            continue
        signed = head[magic] == 0xFD and head[magic + 2] & 1
        end = magic + head[magic + 1] + overhead + (_SIGNATURE if signed else 0)
        count, start = lines.pop(magic - stamp, (0, magic - stamp))
        count += 1
        if count >= _CHAIN or (count >= _FEW and start == 0 and end == len(head)):
            return True
        if count > lines.get(end, (0, 0))[0]:
            lines[end] = count, start
    return False
