"""What the judging of a log leaves beside its verdicts: a recording, a report, or what a caller collects."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from mavhums.core.errors import MavhumsError
from mavhums.core.output import as_utf8, written_whole
from mavhums.core.packed import is_stream
from mavhums.engine.events import Event
from mavhums.log import read_blocks
from mavhums.results.assessment import Assessment

Place = str | os.PathLike[str]


class Follower(Protocol):
    """Takes the events of one log in their order, and its assessment at the end."""

    def consume(self, events: Sequence[Event], /) -> None:
        """Take the events of a block."""

    def close(self, assessment: Assessment, /) -> None:
        """Take the assessment; what is written appears in its place, whole."""


class Sink(Protocol):
    """Something that the judging of a log is to leave.

    Attributes
    ----------
    draws
        Whether the events must include attitude, position, flight mode, and the network's answer for each
        sample.
    """

    @property
    def draws(self) -> bool: ...  # noqa: D102

    def follow(self, log: Path, dialect: Place | None) -> AbstractContextManager[Follower]:
        """Return what follows a log; without its ``close`` nothing is left."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A Rerun recording.

    Attributes
    ----------
    path
        The recording; it is written whole or not at all, and replaces an older one.
    position
        Whether it contains the aircraft's position.
    """

    path: Place
    position: bool = True
    draws: ClassVar[bool] = True

    def follow(self, log: Path, dialect: Place | None) -> AbstractContextManager[Follower]:
        """Return the recorder of a log.

        Raises
        ------
        MavhumsError
            If the log cannot be read twice: its hash identifies the recording.
        MissingExtraError
            If rerun is not installed.
        """
        from mavhums.show.recorder import Recorder, check_viewer

        if is_stream(log):
            raise MavhumsError(
                f"{log}: a recording needs a file that can be read twice", "save the log first"
            )
        check_viewer()
        identity = f"{as_utf8(log.name)}-{sha256_of(log, dialect)[:16]}"
        return Recorder(self.path, recording_id=identity, position=self.position)


@dataclass(frozen=True, slots=True)
class Report:
    """A self-contained HTML file, made in bounded memory.

    Attributes
    ----------
    path
        The file; it is written whole or not at all, and replaces an older one.
    parts
        Path of its parts as JSON, for a page that draws the curves itself; None for none.
    """

    path: Place
    parts: Place | None = None
    draws: ClassVar[bool] = True  # the curves show the demanded and the flown angles

    @contextmanager
    def follow(self, log: Path, dialect: Place | None) -> Iterator[Follower]:
        """Yield the writer of a log's report.

        Raises
        ------
        MavhumsError
            If the file cannot be written, or would replace the log.
        """
        target = Path(self.path)
        if log.exists() and target.exists() and log.samefile(target):
            raise MavhumsError(f"{target}: is the log itself", "name another file with -o")
        with written_whole(target) as temporary:
            yield _ReportWriter(temporary, self.parts)


class _ReportWriter:
    def __init__(self, file: Path, parts: Place | None) -> None:
        from mavhums.show.curves import EvidenceCollector

        self._file, self._parts, self._evidence = file, parts, EvidenceCollector()

    def consume(self, events: Sequence[Event]) -> None:
        self._evidence.consume(events)

    def close(self, assessment: Assessment) -> None:
        from mavhums.show.html import page, parts

        self._file.write_text(page(assessment, self._evidence), encoding="utf-8", errors="replace")
        if self._parts is not None:
            Path(self._parts).write_text(json.dumps(parts(assessment, self._evidence)), encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Events:
    """A function of the caller that is called with the events of each block."""

    consume: Callable[[Sequence[Event]], None]
    draws: bool = False

    def follow(self, log: Path, dialect: Place | None) -> AbstractContextManager[Follower]:
        """Return itself: nothing is to be prepared."""
        return nullcontext(self)

    def close(self, assessment: Assessment) -> None:
        """Do nothing: the caller has the assessment."""


def sha256_of(log: Place, dialect: Place | None) -> str:
    """Return the hash of a log's content, unpacked."""
    digest = hashlib.sha256()
    for block in read_blocks(log, dialect=dialect):
        digest.update(block)
    return digest.hexdigest()
