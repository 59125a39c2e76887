"""Outputs that never block their writer: a bounded queue, and a thread that empties it.

A stopped terminal, a pipe without a reader, a full disk or a viewer that hangs loses its own
output, and affects nothing else.
"""

from __future__ import annotations

import io
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TextIO, TypeVar

_LOG = logging.getLogger(__name__)
_ROOM: Final = 4 << 20

Item = TypeVar("Item")


class BoundedQueue(Generic[Item]):
    """Items that wait; where their weight exceeds the room, the oldest are dropped and counted.

    Attributes
    ----------
    dropped
        Number of items that were dropped.

    Examples
    --------
    >>> queue = BoundedQueue(room=10)
    >>> queue.put("old", 6), queue.put("new", 6), queue.pop(), queue.dropped
    (None, None, 'new', 1)
    """

    def __init__(self, room: int) -> None:
        self.dropped = 0
        self._room, self._weight = room, 0
        self._items: deque[tuple[Item, int]] = deque()

    def __bool__(self) -> bool:
        return bool(self._items)

    def put(self, item: Item, weight: int = 1) -> None:
        """Queue an item; an item alone may exceed the room."""
        self._items.append((item, weight))
        self._weight += weight
        while self._weight > self._room and len(self._items) > 1:
            self.pop()
            self.dropped += 1

    def pop(self) -> Item:
        """Return the oldest item."""
        item, weight = self._items.popleft()
        self._weight -= weight
        return item

    def clear(self) -> None:
        """Drop all items."""
        self.dropped += len(self._items)
        self._items.clear()
        self._weight = 0


class Outlet(Generic[Item]):
    """Passes items to ``take`` in a separate thread.

    Parameters
    ----------
    name
        Name of the output in messages.
    take
        Called with each item, in order; an exception loses that item.
    room
        Total weight of the items that may wait; above it, the oldest are dropped.
    report
        Takes a message when the output fails and when it works again; None for no messages.

    Attributes
    ----------
    error
        Reason why the last item failed; None if it did not fail.
    gone
        Whether the receiver is gone.
    """

    def __init__(
        self,
        name: str,
        take: Callable[[Item], object],
        *,
        room: int = _ROOM,
        report: Callable[[str], object] | None = _LOG.warning,
    ) -> None:
        self.name, self.gone = name, False
        self.error: str | None = None
        self._take, self._report = take, report
        self._waiting: BoundedQueue[Item] = BoundedQueue(room)
        self._refused = 0
        self._closing = False
        self._busy = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Number of items that were dropped or failed."""
        return self._waiting.dropped + self._refused

    def put(self, item: Item, weight: int = 1) -> None:
        """Queue an item at once; drop the oldest items if there is no room."""
        with self._change:
            if self._closing:
                self._refused += 1
                return
            self._waiting.put(item, weight)
            self._change.notify_all()

    def close(self, timeout_s: float) -> bool:
        """Accept no more items; return whether all waiting items were passed on within the time."""
        with self._change:
            self._closing = True
            self._change.notify_all()
            emptied = self._change.wait_for(lambda: not self._waiting and not self._busy, timeout_s)
            if not emptied:
                self._waiting.clear()
        return emptied

    def _run(self) -> None:
        while True:
            with self._change:
                self._busy = False
                self._change.notify_all()
                self._change.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                item = self._waiting.pop()
                self._busy = True
            self._hand_over(item)

    def _hand_over(self, item: Item) -> None:
        try:
            self._take(item)
        except Exception as error:
            self._refused += 1
            self.gone = self.gone or isinstance(error, BrokenPipeError)
            why = (error.strerror if isinstance(error, OSError) else None) or str(error) or repr(error)
            before, self.error = self.error, why
            if before is None and self._report:
                self._report(f"{self.name}: {why}; its output is dropped, everything else continues")
        else:
            if self.error is not None and self._report:
                self._report(f"{self.name}: works again; {self.dropped} dropped")
            self.error = None


class Spool(io.TextIOBase):
    """A text stream whose writer never waits; text flushed together is shown together or not at all.

    Parameters
    ----------
    stream
        Destination of the text; None, if the program was started without it, discards the text.
    name
        Name in messages.
    report
        The same as for :class:`Outlet`.
    """

    def __init__(
        self, stream: TextIO | None, name: str, *, report: Callable[[str], object] | None = _LOG.warning
    ) -> None:
        if stream:
            stream.flush()
        self._stream = stream
        self._torn = False
        self._pending: list[str] = []
        self._descriptor = _descriptor(self._stream)
        self.outlet: Outlet[str] = Outlet(name, self._write_text, report=report)

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the underlying stream."""
        return (self._stream and self._stream.encoding) or "utf-8"

    def isatty(self) -> bool:
        """Return whether the stream is interactive."""
        return bool(self._stream and self._stream.isatty())

    def fileno(self) -> int:
        """Return the descriptor of the underlying stream."""
        if self._stream is None:
            raise io.UnsupportedOperation("fileno")
        return self._stream.fileno()

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, text: str) -> int:
        """Keep text until it is flushed."""
        self._pending.append(text)
        return len(text)

    def flush(self) -> None:
        """Queue the written text."""
        pending, self._pending = "".join(self._pending), []
        if pending:
            self.outlet.put(pending, len(pending))

    def finish(self, until_s: float) -> bool:
        """Return whether everything is shown before a time of the monotonic clock."""
        self.flush()
        return self.outlet.close(max(until_s - time.monotonic(), 0.0))

    def _write_text(self, text: str) -> None:
        if self._stream is None:
            return
        if self._descriptor is None:
            self._stream.write(text)
            self._stream.flush()
            return
        data = text.encode(self.encoding, "replace")
        if self._torn:
            data = b"\n" + data
        start, left = len(data), memoryview(data)
        try:
            while left:
                left = left[os.write(self._descriptor, left) :]
        finally:
            self._torn = bool(left) and (self._torn or len(left) < start)


def _descriptor(stream: TextIO | None) -> int | None:
    """Return the underlying file, which has no lock that a stalled write could hold; None without one."""
    if os.name != "posix" or stream is None:
        return None
    try:
        return stream.fileno()
    except (OSError, ValueError):
        return None
