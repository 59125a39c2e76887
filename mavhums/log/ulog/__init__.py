"""PX4's on-board log, ULog (``.ulg``)."""

from __future__ import annotations

from mavhums.log.base.decoder import Refusal
from mavhums.log.formats import pieces
from mavhums.log.ulog.decoder import UlogDecoder
from mavhums.log.ulog.scanner import HEADER, UlogScanner, flag_bits

__all__ = ["decoder", "refusal"]

_CUT = "copy the log again from the card, or take another one"


decoder = UlogDecoder


def refusal(head: bytes) -> Refusal | None:
    """Return why a log that begins with ``head`` cannot be read; None if it can."""
    flags = head[HEADER + 3 :][:40].ljust(40, b"\0")
    if head[HEADER + 2 : HEADER + 3] == b"B" and flag_bits(flags)[0]:
        return Refusal("this ULog needs a newer reader (unknown incompatible flags)", "update mavhums")
    scanner = UlogScanner()
    rows = 0
    # A message and a topic settle it, usually in the first piece.
    for piece, final in pieces(head):
        rows += sum(batch.rows.size for batch in scanner.feed(piece, final=final))
        if rows and scanner.topics.layouts:
            return None
    if rows == 0:
        return Refusal("no message in the first megabyte of this ULog", _CUT)
    return Refusal("this ULog defines no topic in its first megabyte", _CUT)
