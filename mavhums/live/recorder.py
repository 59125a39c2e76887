"""The telemetry log of a session: one record per accepted frame, on the disk within a second."""

from __future__ import annotations

import logging
import os
import threading
from datetime import UTC, datetime
from pathlib import Path

from mavhums.core.errors import MavhumsError

_LOG = logging.getLogger(__name__)
_SYNC_S = 1.0
_CLOSE_S = 1.0


class TlogRecorder:
    """Writes records to a new file; a full disk loses records but never ends the session.

    Each call passes its records to the operating system whole or not at all, so that the file always
    ends with a whole record, and once a second they are synced to the disk. After an error, every
    call tries again; records that could not be written are counted. Once a second, the recorder checks that
    the file still exists under its name.

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

    Raises
    ------
    MavhumsError
        If the file exists, or cannot be created.
    """

    def __init__(self, path: Path, *, start: datetime | None = None) -> None:
        self.path = Path((start or datetime.now(UTC)).strftime(str(path)))
        self.bytes = self.lost_frames = 0
        self._failure: str | None = None
        self._absence: str | None = None
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

    @property
    def error(self) -> str | None:
        """Reason why nothing is recorded, or not at the intended place; None if recording works."""
        return self._failure or self._absence

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
        if self._failure is not None:
            _LOG.warning("%s: written again; %d frames are missing", self.path, self.lost_frames)
            self._failure = None

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
        if self._failure is None:
            _LOG.error("%s: %s; the flight is judged, but not recorded", self.path, error.strerror)
        self._failure = error.strerror or str(error)

    def _sync_often(self) -> None:
        closing = False
        while not closing:
            closing = self._closing.wait(_SYNC_S)
            self._sync()
            self._look()
        os.close(self._file)

    def _look(self) -> None:
        """Check that the file still exists under its name."""
        absence = None
        try:
            written = os.fstat(self._file)
            if not written.st_nlink:
                absence = "the file was removed"
            elif not os.path.samestat(written, self.path.stat()):
                absence = "the file was moved"
        except FileNotFoundError:
            absence = "the file was moved"
        except OSError as error:
            absence = error.strerror or str(error)
        if absence and absence != self._absence:
            _LOG.error("%s: %s while it is written%s", self.path, absence, self._rescue(absence))
        self._absence = absence

    def _rescue(self, absence: str) -> str:
        """Return how to save the written data."""
        there = Path(f"/proc/{os.getpid()}/fd/{self._file}")
        if absence != "the file was removed" or not there.exists():
            return "; writing continues"
        return f"; until this program ends, save it: cp {there} flight.tlog"

    def _sync(self) -> None:
        if self._synced == self.bytes:
            return
        reached = self.bytes
        try:
            os.fsync(self._file)
            self._synced = reached
        except OSError as error:
            _LOG.error("%s: %s; what was written last may be lost", self.path, error.strerror)
