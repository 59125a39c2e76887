"""Detection of missing time stamps and of text conversion, and its reversal, in a stream.

A log without time stamps (``.tlog.raw``) has its frames back to back; a capture of a serial line
may begin with boot text or in the middle of a frame. A log that a program copied as text has a
carriage return before every line feed. The reversal of this conversion is unambiguous, because an
original carriage return is followed by a second one.
"""

from __future__ import annotations

from mavhums.log.mavlink.dialect import Dialect
from mavhums.log.mavlink.scanner import FrameScanner
from mavhums.log.mavlink.signing import frame_sizes

__all__ = ["Intake"]

_CR, _LF, _CRLF = b"\r", b"\n", b"\r\n"
_EVIDENCE = 3  # carriage returns: one or two come by chance in a few kilobytes of binary data
_HELD = 1 << 12  # bytes in which a converted log has several line feeds, an original one a bare line feed
_HEAD = 1 << 10  # bytes: more than three of the longest frames
_CAPTURE = 1 << 14  # bytes: a second of a serial line at 115,200 baud, boot text included
_LEAST_ADJACENT = 2
_MAGIC = (0xFD, 0xFE)
_STAMP = 8


class Intake:
    """Detects a stream's format from its bytes, reverses text conversion, and passes the bytes on.

    Bytes are buffered only until the format is known: up to 1 KiB if the stream begins with a magic
    byte, up to 16 KiB if it does not begin with a record. If the first line feed follows a carriage
    return, bytes are buffered until a line feed without one, or until 4 KiB contain more frames
    without the carriage returns.

    Attributes
    ----------
    stamp
        Size of the time stamp before each frame, bytes: 8 or 0; None until it is known.
    line_ends
        Number of carriage returns removed.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.stamp: int | None = None
        self.line_ends = 0
        self._dialect = dialect
        self._text: bool | None = None
        self._held = b""
        self._head = b""

    def feed(self, block: bytes, *, final: bool = False) -> bytes:
        """Return the bytes that can be decoded now; ``final`` marks the end of the stream."""
        data = self._restore(block, final)
        if self.stamp is not None:
            return data
        self._head += data
        self.stamp = self._stamp_of(self._head, final)
        if self.stamp is None:
            return b""
        data, self._head = self._head, b""
        return data

    def _restore(self, block: bytes, final: bool) -> bytes:
        if self._text is False:
            return block
        data, self._held = self._held + block, b""
        before = b""
        if self._text is None:
            first = data.find(_LF)
            if first >= 0:
                begin = max(first - 1, 0)
                before, data = data[:begin], data[begin:]
                self._text = self._is_text(data, final)
                if self._text is False:
                    return before + data
                if self._text is None:
                    self._held = data
                    return before
        if data.endswith(_CR) and not final:
            data, self._held = data[:-1], _CR
        if self._text:
            whole = len(data)
            data = data.replace(_CRLF, _LF)
            self.line_ends += whole - len(data)
        return before + data

    def _is_text(self, data: bytes, final: bool) -> bool | None:
        """Return whether ``data``, from the first line feed on, was converted; None if not yet known."""
        head = data[:_HELD]
        if head.count(_LF) > head.count(_CRLF):
            return False
        if len(head) < _HELD and not final:
            return None
        restored = head.replace(_CRLF, _LF)
        return len(head) - len(restored) >= _EVIDENCE and self._frames(restored) > self._frames(head)

    def _frames(self, data: bytes) -> int:
        return FrameScanner(self._dialect).feed(data, final=True).rows.size

    def _stamp_of(self, head: bytes, final: bool) -> int | None:
        """Return the size of the time stamp before each frame, bytes; None if not yet known."""
        if not head:
            return None
        if head[0] in _MAGIC:
            if len(head) < _HEAD and not final:
                return None
            if self._is_back_to_back(head[:_HEAD]):
                return 0
        elif self._begins_with_record(head[:_HEAD]):
            return 8
        if len(head) < _CAPTURE and not final:
            return None
        return 0 if self._is_capture(head[:_CAPTURE]) else 8

    def _begins_with_record(self, head: bytes) -> bool:
        rows = FrameScanner(self._dialect).feed(head).rows
        return bool(rows.size and rows["offset"][0] == 0)

    def _is_capture(self, head: bytes) -> bool:
        """Return whether more frames follow another directly than after the size of a time stamp."""
        rows = FrameScanner(self._dialect, stamp=0).feed(head, final=True).rows
        gaps = rows["offset"][1:] - (rows["offset"] + frame_sizes(rows))[:-1]
        adjacent = int((gaps == 0).sum())
        return adjacent >= _LEAST_ADJACENT and adjacent > int((gaps == _STAMP).sum())

    def _is_back_to_back(self, head: bytes) -> bool:
        rows = FrameScanner(self._dialect, stamp=0).feed(head, final=True).rows
        if rows.size == 0 or head[0] not in _MAGIC or rows["offset"][0] or rows["definition"][0] < 0:
            return False
        size = int(rows["length"][0]) + (8 if head[0] == _MAGIC[1] else 25 if head[2] & 1 else 12)
        return bool(size >= len(head) or head[size] in _MAGIC)
