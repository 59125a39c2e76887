"""Outputs that never block their writer: a bounded queue, a thread that empties it, and the recorded log.

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
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Generic, TextIO, TypeVar

from mavhums.core.errors import MavhumsError

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


_SYNC_S = 1.0
_CLOSE_S = 1.0


class TlogRecorder:
    """Writes records to a new file; a full disk loses records but never ends the session.

    Each call passes its records to the operating system whole or not at all, so that the file always
    ends with a whole record, and once a second they are synced to the disk. After an error, every
    call tries again; records that could not be written are counted.

    Parameters
    ----------
    path
        Path of the file; ``%Y%m%d-%H%M%S`` and similar codes give the start time, UTC.

    Attributes
    ----------
    path
        Path of the file in use.
    bytes, lost_frames
        Number of bytes written, and of frames that could not be written.
    error
        Reason why nothing is recorded; None if recording works.

    Raises
    ------
    MavhumsError
        If the file exists, or cannot be created.
    """

    def __init__(self, path: Path, *, start: datetime | None = None) -> None:
        self.path = Path((start or datetime.now(UTC)).strftime(str(path)))
        self.bytes = self.lost_frames = 0
        self.error: str | None = None
        try:
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o600)
        except FileExistsError as error:
            raise MavhumsError(
                f"{self.path}: exists already, and a flight is not overwritten",
                "name another file, or one for each start: flight-%Y%m%d-%H%M%S.tlog",
            ) from error
        except OSError as error:
            raise MavhumsError(
                f"cannot write {self.path}: {error.strerror}", "choose another place"
            ) from error
        self._closing = threading.Event()
        self._synced = 0
        self._syncer = threading.Thread(target=self._sync_often, name="tlog-sync", daemon=True)
        self._syncer.start()

    def write(self, records: bytes, frames: int) -> None:
        """Append whole records, ``frames`` in number."""
        if not records:
            return
        try:
            written = os.write(self._file, records)
            while 0 < written < len(records):
                written += os.write(self._file, records[written:])
        except OSError as error:
            self._fail(error, frames)
            return
        self.bytes += len(records)
        if self.error is not None:
            _LOG.warning("%s: written again; %d frames are missing", self.path, self.lost_frames)
            self.error = None

    def close(self) -> None:
        """Sync everything to the disk and close the file; do not wait for a slow disk."""
        self._closing.set()
        self._syncer.join(_CLOSE_S)
        if self._syncer.is_alive():
            _LOG.warning("%s: the disk is slow; the last seconds may be lost if power fails now", self.path)

    def _fail(self, error: OSError, frames: int) -> None:
        self.lost_frames += frames
        try:
            os.ftruncate(self._file, self.bytes)
        except OSError as again:
            error = again
        if self.error is None:
            _LOG.error("%s: %s; the flight is judged, but not recorded", self.path, error.strerror)
        self.error = error.strerror or str(error)

    def _sync_often(self) -> None:
        closing = False
        while not closing:
            closing = self._closing.wait(_SYNC_S)
            self._sync()
        os.close(self._file)

    def _sync(self) -> None:
        if self._synced == self.bytes:
            return
        reached = self.bytes
        try:
            os.fsync(self._file)
            self._synced = reached
        except OSError as error:
            _LOG.error("%s: %s; what was written last may be lost", self.path, error.strerror)
