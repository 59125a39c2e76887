"""Queues whole frames for a stream whose receiver may stall, without waiting."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

__all__ = ["Outgoing"]

_ROOM: Final = 4096


class Outgoing:
    """Holds at most a few kilobytes of frames; when full, it drops the oldest frame not yet started.

    Attributes
    ----------
    dropped
        Number of frames that were not sent completely.

    Examples
    --------
    >>> out, sent = Outgoing(), []
    >>> out.offer(b"frame")
    >>> out.pump(lambda data: sent.append(bytes(data)) or len(data))
    >>> sent
    [b'frame']
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._frames: deque[bytes] = deque()
        self._begun = b""

    def offer(self, frame: bytes) -> None:
        """Queue a frame."""
        self._frames.append(frame)
        while sum(map(len, self._frames)) > _ROOM:
            self._frames.popleft()
            self.dropped += 1

    def refuse(self) -> None:
        """Count a frame without a destination."""
        self.dropped += 1

    def pump(self, write: Callable[[bytes], int]) -> None:
        """Write as much as possible; ``write`` returns how many bytes it took, or raises."""
        try:
            while self._begun or self._frames:
                if not self._begun:
                    self._begun = self._frames.popleft()
                taken = write(self._begun)
                if not taken:
                    return
                self._begun = self._begun[taken:]
        except OSError:
            return  # full or broken: the reading side detects it

    def clear(self) -> None:
        """Drop everything after the stream has ended."""
        self.dropped += len(self._frames) + bool(self._begun)
        self._frames.clear()
        self._begun = b""
