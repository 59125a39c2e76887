"""A folder of flights: one per file, each an assessment with the record that only later comparisons need.

Files of ``mavhums analyse --json`` are flights without a record, one or several per file.

Subfolders are not read, because most aircraft have system id 1 and would be mixed up. The checkpoint lies in
a file beside the flights, so that one more flight costs the same after few flights and after many.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from operator import attrgetter
from pathlib import Path
from stat import S_ISDIR
from typing import Final, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.core.about import __version__
from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole
from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import KnownAircraft
from mavhums.flights.aircraft_table import Since
from mavhums.flights.checkpoint import Checkpoint
from mavhums.flights.flight_file import KeptFlight, _ForeignFileError, read_flights, reason_of
from mavhums.flights.history import FlightHistory, PastFlight, UndatedError
from mavhums.health.decision.baseline import Baselines, PastRecord
from mavhums.results.assessment import RECORD, Assessment

CHECKPOINT: Final = ".mavhums-checkpoint"
"""Name of the file with the checkpoint, beside the flights."""

_VERSION: Final = f"1 of mavhums {__version__}"

_RECENT_FILES: Final = 200
"""Files that are read after each landing to tell how the aircraft stands; a year of flights."""

_Stamp = tuple[int, int]
"""Time of modification in nanoseconds, and size in bytes."""


class _StoreHeader(NamedTuple):
    """What is stored before the flights; ``latest`` is the start of the last one, UTC."""

    version: str
    files: tuple[tuple[str, _Stamp], ...]
    since: tuple[tuple[str | None, datetime], ...]
    errors: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    owners: tuple[KnownAircraft, ...]
    latest: datetime | None


_KEPT: Final = TypeAdapter(_StoreHeader)
_MAY_HOLD = re.compile(r"[^.].*\.json", re.IGNORECASE | re.DOTALL)
_name = attrgetter("name")


def keep_assessment(assessment: Assessment, folder: str | os.PathLike[str]) -> Path:
    """Write an assessment and its record into a folder of flights atomically, and return the path.

    The file name consists of the log's name and hash, so two logs never share a file; a new
    assessment of a log replaces the old one.

    Raises
    ------
    MavhumsError
        If the folder cannot be written.
    """
    log = assessment.log
    stem = re.sub(r"[^\w.-]+", "_", Path(log.path or "").stem).strip("._-") or "log"
    path = Path(folder) / f"{stem[:60]}-{(log.sha256 or 'unknown')[:16]}.json"
    try:
        path.parent.mkdir(0o700, parents=True, exist_ok=True)
    except OSError as error:
        problem = f"{folder}: cannot be used as a folder of flights: {reason_of(error)}"
        raise MavhumsError(problem, "name another with --history") from error
    with written_whole(path) as temporary:
        # How it stood is told from the flights again: what came late may change it.
        kept = KeptFlight.of(assessment.model_copy(update={"standings": ()}))
        text = kept.model_dump_json(by_alias=True, indent=2, exclude={"assessment": RECORD})
        temporary.write_text(text + "\n", encoding="utf-8")
    return path


def read_history(
    folder: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
) -> FlightHistory:
    """Read the assessments in a folder's ``*.json`` files.

    Other files and subfolders are ignored. JSON that is not an assessment, and assessments of logs
    without a date, are skipped with a notice.

    Parameters
    ----------
    folder
        Folder of one aircraft, or of a fleet whose aircraft have different system ids.
    progress
        Called with the number of files read and the total.

    Raises
    ------
    MavhumsError
        If the folder does not exist. Files that cannot be read are reported in ``errors`` instead.
    """
    folder = Path(folder)
    paths = [Path(entry) for entry in _assessment_files(folder)]
    outcomes = (outcome for path in _counted(paths, progress) for outcome in read_flights(path))
    history = _history(folder, outcomes)
    notices = list(history.notices)
    paths_of = {flight.log: flight.assessment.log.path or "a live link" for flight in history.flights}
    duplicates = {(log, best) for (_, log, _), best in history.superseded_recordings().items()}
    for log, best in sorted(duplicates):
        notices.append(
            f"{paths_of[log]} and {paths_of[best]} are of the same flight; {paths_of[best]} counts"
        )
    return replace(history, notices=tuple(notices))


def _history(folder: Path, outcomes: Iterable[PastFlight | MavhumsError]) -> FlightHistory:
    flights: list[PastFlight] = []
    errors: list[MavhumsError] = []
    notices: list[str] = []
    with no_collection():
        for outcome in outcomes:
            if isinstance(outcome, PastFlight):
                flights.append(outcome)
            elif isinstance(outcome, UndatedError | _ForeignFileError):  # left alone, without a loss
                notices.append(outcome.problem)
            else:
                errors.append(outcome)
    history = FlightHistory(tuple(flights))
    older = len(flights) - len(history.flights)
    if older:
        notices.append(f"{folder}: {older} older assessments of logs that were judged again")
    return FlightHistory(history.flights, tuple(errors), tuple(notices), str(folder))


class FlightFolder:
    """The flights in a folder; only files that are new since the checkpoint are read.

    The checkpoint is a cache: it follows the names, times and sizes of the files, and is made anew from all
    of them where it is missing, damaged or of another version, where a file was changed or removed, where a
    flight comes late, and where other dates count.

    Parameters
    ----------
    folder
        The same as for :func:`read_history`.
    progress
        Called with the number of files read and the total.

    Raises
    ------
    MavhumsError
        If the folder does not exist.
    """

    def __init__(
        self, folder: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
    ) -> None:
        self._folder, self._progress = Path(folder), progress
        self._files: dict[str, _Stamp] = {}
        self._read: dict[str, tuple[_Stamp, list[PastFlight | MavhumsError]]] = {}
        self._kept = _StoreHeader(_VERSION, (), (), (), (), (), None)
        self._checkpoint: Checkpoint | None = None
        self._look()
        # Where there is no checkpoint, or a damaged one, the files tell the same.
        with suppress(OSError, ValidationError, MavhumsError):
            head, _, flights = (self._folder / CHECKPOINT).read_bytes().partition(b"\n")
            kept = _KEPT.validate_json(head)
            if kept.version == _VERSION:
                self._checkpoint = Checkpoint.restored(flights, _always(kept.since))
                self._kept = kept
        self._follow(dict(self._kept.since), whole=False)

    @property
    def name(self) -> str:
        """What the history is called in messages."""
        return str(self._folder)

    @property
    def flights(self) -> tuple[PastFlight, ...]:
        """All flights; this reads the whole folder."""
        return self._history(list(self._files)).flights

    @property
    def errors(self) -> tuple[MavhumsError, ...]:
        """Files of the folder that could not be read."""
        return tuple(MavhumsError(problem, remedy) for problem, remedy in self._kept.errors)

    @property
    def notices(self) -> tuple[str, ...]:
        """Files that were ignored without loss of data."""
        return self._kept.notices

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the same as :meth:`FlightHistory.baselines` for the whole folder."""
        return self._follow(since or {}, whole=False).baselines(airframe, before, since or {})

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the same as :meth:`FlightHistory.past` for the whole folder."""
        return self._follow(since or {}, whole=True).past(airframe, before, since or {})

    def recent(self) -> tuple[PastFlight, ...]:
        """Return the flights in the files written last: a landing costs the same after many flights."""
        newest = sorted(self._files, key=lambda name: (self._files[name], name))[-_RECENT_FILES:]
        return self._history(newest).flights

    def owners(self) -> list[KnownAircraft]:
        """Return the same as :meth:`FlightHistory.owners` for the whole folder."""
        return [*self._kept.owners]

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs that may be the same flight."""
        checkpoint = self._checkpoint
        if checkpoint is None or self._kept.latest is None or flight.start < self._kept.latest:
            # The checkpoint identifies only the latest flights; what comes late may be any.
            return self._history(list(self._files)).near(flight)
        return FlightHistory(tuple(checkpoint.open_flights)).near(flight)

    def with_flight(self, assessment: Assessment) -> FlightFolder:
        """Return the folder with one more flight, which is already stored in it."""
        self._look()
        self._follow(dict(self._kept.since), whole=False)
        return self

    def _look(self) -> None:
        """List the files that there are now."""
        self._files = {}
        for entry in _assessment_files(self._folder):
            try:
                status = entry.stat()
            except OSError:
                self._files[entry.name] = (0, -1)
                continue
            if not S_ISDIR(status.st_mode):
                self._files[entry.name] = (status.st_mtime_ns, status.st_size)

    def _follow(self, since: Since, *, whole: bool) -> Checkpoint:
        """Return the checkpoint of the present files and these dates; ``whole`` with all flights' sums."""
        checkpoint, known = self._checkpoint, dict(self._kept.files)
        if checkpoint is not None:
            whole = whole or checkpoint.is_whole
            if dict(self._kept.since) == dict(since) and checkpoint.is_whole == whole:
                if known == self._files:
                    return checkpoint
                if all(self._files.get(name) == stamp for name, stamp in known.items()):
                    new = self._history([name for name in self._files if name not in known])
                    latest = self._kept.latest
                    late = latest is not None and any(each.start <= latest for each in new.flights)
                    if not (late or new.errors or new.notices):
                        return self._add(checkpoint, new, self._kept)
        checkpoint = Checkpoint(_always(since.items()), whole=whole)
        fresh = _StoreHeader(_VERSION, (), tuple(since.items()), (), (), (), None)
        return self._add(checkpoint, self._history(list(self._files)), fresh)

    def _add(self, checkpoint: Checkpoint, new: FlightHistory, before: _StoreHeader) -> Checkpoint:
        """Add flights to a checkpoint, and store it beside them if the folder can be written."""
        with no_collection():
            for flight in new.flights:
                checkpoint.add(flight)
        owners = {owner[:3]: owner for owner in before.owners}
        for owner in new.owners():
            first = owners.get(owner[:3], owner)
            owners[owner[:3]] = owner._replace(starts=(first.starts[0], owner.starts[1]))
        self._checkpoint = checkpoint
        self._kept = before._replace(
            files=tuple(self._files.items()),
            errors=(*before.errors, *((error.problem, error.remedy) for error in new.errors)),
            notices=(*before.notices, *new.notices),
            owners=tuple(owners.values()),
            latest=new.flights[-1].start if new.flights else before.latest,
        )
        with suppress(OSError, MavhumsError), written_whole(self._folder / CHECKPOINT) as temporary:
            temporary.write_bytes(_KEPT.dump_json(self._kept) + b"\n" + checkpoint.packed())
        return checkpoint

    def _history(self, names: Sequence[str]) -> FlightHistory:
        """Read files, each once as long as it does not change: many late flights may come in one run."""
        unread = [name for name in names if self._read.get(name, (None,))[0] != self._files[name]]
        for path in _counted([self._folder / name for name in unread], self._progress):
            self._read[path.name] = (self._files[path.name], [*read_flights(path)])
        return _history(self._folder, (each for name in names for each in self._read[name][1]))


def _always(since: Iterable[tuple[str | None, datetime]]) -> Callable[[datetime], Since]:
    dates = dict(since)
    return lambda _: dates


def _counted(paths: Sequence[Path], progress: Callable[[int, int], None] | None) -> Iterator[Path]:
    for number, path in enumerate(paths, 1):
        if progress:
            progress(number, len(paths))
        if not path.is_dir():
            yield path


def _assessment_files(folder: Path) -> list[os.DirEntry[str]]:
    """Return the files of a folder that may hold assessments, by name.

    Raises
    ------
    MavhumsError
        If there is no such folder.
    """
    try:
        with os.scandir(folder) as entries:
            return sorted((entry for entry in entries if _MAY_HOLD.fullmatch(entry.name)), key=_name)
    except OSError as error:
        remedy = f"analyse a first flight into it: mavhums analyse LOG --history {folder} --keep"
        raise MavhumsError(f"{folder}: {reason_of(error)}", remedy) from error
