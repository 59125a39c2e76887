"""What the file of a running live session says, read on as it grows."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import IO, Final, Self

from pydantic import TypeAdapter, ValidationError

from mavhums.core.errors import UnreadableLogError
from mavhums.core.packed import opened_file
from mavhums.results.live import (
    AlertObject,
    ConditionObject,
    EndObject,
    LiveObject,
    StartObject,
    StatusObject,
)
from mavhums.show.blocks import Block, Headline, Listing, Note
from mavhums.show.now import latest_line, status_blocks

_FIRST: Final = 1 << 16
_READ: Final = 1 << 20
_LINE: Final = 1 << 22
_CHANGES: Final = 12
_SILENT_S: Final = 5.0
_OBJECT: Final[TypeAdapter[LiveObject]] = TypeAdapter(LiveObject)


class LiveFile:
    """A session's file, read on as it grows; of a long one, only the beginning and the last MiB.

    Parameters
    ----------
    path
        The file; it may not exist yet.

    Attributes
    ----------
    note
        Why the state may not be the present one; empty while the session runs.
    start, status, end
        The latest objects of these kinds; None before any.
    changes
        The latest changes of conditions and alerts, the newest first.
    """

    def __init__(self, path: Path) -> None:
        self.note = ""
        self._path = path
        self._forget()

    def _forget(self) -> None:
        self._at = 0
        self._rest = b""
        self._first = True
        self.start: StartObject | None = None
        self.status: StatusObject | None = None
        self.end: EndObject | None = None
        self.changes: tuple[ConditionObject | AlertObject, ...] = ()

    def seen(self) -> Self:
        """Read what was added, and return the session as it is now."""
        self.note = ""
        try:
            status = self._path.stat()
            if status.st_size < self._at:
                self._forget()
            with opened_file(self._path) as file:
                self._read(file, status.st_size)
            silent_s = time.time() - status.st_mtime
            if self.end is None and silent_s > _SILENT_S:
                self.note = (
                    f"no line for {silent_s:,.0f} s: the session has stopped, or its output is not read"
                )
        except OSError as error:
            self.note = f"cannot be read: {error.strerror}"
        except UnreadableLogError as error:
            self.note = f"{error.problem}: let the session write to a file: mavhums live --json > FILE"
        return self

    def blocks(self) -> list[Block]:
        """Return what is shown of the session."""
        state = " (ended)" if self.end else " (running)" if self.status and not self.note else ""
        title, start = f"{self._path.name}{state}", self.start
        shown = status_blocks(self.status, title) if self.status else [Headline(title)]
        about = []
        if start:
            facts = [", ".join(start.links), start.airframe, start.record and f"recorded to {start.record}"]
            about = [Note([" · ".join(filter(None, facts))], quiet=True)]
        notes = [Note([self.note or "No state yet."])] if self.note or not self.status else []
        changes = [Listing("Latest changes", [*map(latest_line, self.changes)])] if self.changes else []
        return [shown[0], *notes, *about, *shown[1:], *changes]

    def _read(self, file: IO[bytes], size: int) -> None:
        if self._first and size:
            self._take(file.read(_FIRST).split(b"\n")[0])
            self._at = max(0, size - _READ)
            self._first = False
        file.seek(self._at)
        while self._at < size and (data := file.read(min(_READ, size - self._at))):
            self._at += len(data)
            *lines, self._rest = (self._rest + data).split(b"\n")
            self._rest = self._rest if len(self._rest) <= _LINE else b""
            for line in lines:
                self._take(line)

    def _take(self, line: bytes) -> None:
        """Take a line; one that is cut or of another format is skipped."""
        try:
            found = _OBJECT.validate_python(json.loads(line), strict=False)
        except (ValidationError, ValueError, RecursionError):
            return
        if isinstance(found, StartObject):
            self.start, self.end = found, None
        elif isinstance(found, StatusObject):
            self.status = found
        elif isinstance(found, EndObject):
            self.end = found
        elif isinstance(found, ConditionObject | AlertObject) and found not in self.changes:
            self.changes = (found, *self.changes)[:_CHANGES]
