"""A folder of assessments in the format of ``mavhums analyse --json``: one or several per file.

Subfolders are not read, because most aircraft have system id 1 and would be mixed up.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import from_json

from mavhums.core.collecting import no_collection
from mavhums.core.errors import MavhumsError
from mavhums.core.files import written_whole
from mavhums.flights.history import FlightHistory, PastFlight, UndatedError
from mavhums.report.assessment import READABLE, SCHEMA, Assessment

__all__ = ["UnusedError", "assessment_files", "keep_assessment", "read_file", "read_history"]

_FAMILY = SCHEMA.split("/", maxsplit=1)[0] + "/"
_LARGEST_FILE = 256 << 20
_LARGEST_VALUE = 1e12
_MAY_HOLD = re.compile(r"[^.].*\.json", re.IGNORECASE | re.DOTALL)
_name = attrgetter("name")
_AGAIN = "analyse its log again"


def keep_assessment(assessment: Assessment, folder: str | os.PathLike[str]) -> Path:
    """Write an assessment into a folder of flights atomically, and return its path.

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
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = f"{folder}: cannot be used as a folder of flights: {_words(error)}"
        raise MavhumsError(problem, "name another with --history") from error
    with written_whole(path) as temporary:
        temporary.write_text(assessment.to_json() + "\n", encoding="utf-8")
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
    paths = [Path(entry) for entry in assessment_files(folder)]
    flights: list[PastFlight] = []
    errors: list[MavhumsError] = []
    notices: list[str] = []
    with no_collection():
        for outcome in _read(paths, progress):
            if isinstance(outcome, PastFlight):
                flights.append(outcome)
            elif isinstance(outcome, UnusedError):
                notices.append(outcome.problem)
            else:
                errors.append(outcome)
    history = FlightHistory(tuple(flights), tuple(errors), ())
    twice = len(flights) - len(history.flights)
    if twice:
        notices.append(f"{folder}: {twice} older assessments of logs that were judged again")
    paths_of = {flight.log: flight.assessment.log.path or "a live link" for flight in history.flights}
    for log, taken in sorted({(log, taken) for (_, log, _), taken in history.untaken().items()}):
        told = f"{paths_of[log]} and {paths_of[taken]} are of the same flight; {paths_of[taken]} counts"
        notices.append(told)
    return FlightHistory(history.flights, history.errors, tuple(notices), str(folder))


def _read(
    paths: Sequence[Path], progress: Callable[[int, int], None] | None
) -> Iterator[PastFlight | MavhumsError]:
    for number, path in enumerate(paths, 1):
        if progress:
            progress(number, len(paths))
        if not path.is_dir():
            yield from read_file(path)


class _ForeignError(MavhumsError):
    """A JSON file that is not an assessment."""


UnusedError = UndatedError | _ForeignError
"""What a file is left alone for, without a loss."""


def assessment_files(folder: Path) -> list[os.DirEntry[str]]:
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
        raise MavhumsError(f"{folder}: {_words(error)}", remedy) from error


def read_file(path: Path) -> Iterator[PastFlight | MavhumsError]:
    """Yield each assessment of a file, or the error in it."""
    try:
        written = path.stat().st_mtime
        items = _items(path)
    except OSError as error:
        yield MavhumsError(f"{path}: {_words(error)}", "make it readable, or take it out of the folder")
        return
    except MavhumsError as error:
        yield error
        return
    for where, item in items:
        try:
            assessment = Assessment.model_validate(item)
            _hold_plausible(assessment, path)
            yield PastFlight.of(assessment, path, written)
        except ValidationError as error:
            mistake = error.errors(include_input=False, include_url=False)[0]
            place = ".".join(str(part) for part in (*where, *mistake["loc"]))
            yield MavhumsError(f"{path}: {place[:120]}: {mistake['msg'][:120]}", _AGAIN)
        except MavhumsError as error:
            yield error


def _items(path: Path) -> list[tuple[tuple[str | int, ...], Any]]:
    """Return the unvalidated assessments in a file, each with its location in the JSON."""
    content = _json(path)
    schema = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(schema, str) or not schema.startswith(_FAMILY):
        raise _ForeignError(f"{path}: is no assessment, and was left alone")
    if schema not in READABLE:
        raise MavhumsError(
            f"{path}: is of the schema {schema[:60]!r}, not {SCHEMA}", f"update mavhums, or {_AGAIN}"
        )
    several = content.get("assessments")
    if isinstance(several, list):
        return [(("assessments", place), item) for place, item in enumerate(several)]
    return [((), content)]


def _json(path: Path) -> Any:
    if not path.is_file() or path.stat().st_size > _LARGEST_FILE:
        raise MavhumsError(f"{path}: not a regular file of an assessment's size", "take it out of the folder")
    data = path.read_bytes()
    try:
        return from_json(data.decode(json.detect_encoding(data)), allow_inf_nan=False)
    except ValueError as error:
        problem = f"{path}: is no whole JSON file: {str(error)[:100]}"
        raise MavhumsError(problem, f"if it was an assessment, {_AGAIN}; else take it out") from error


def _hold_plausible(assessment: Assessment, path: Path) -> None:
    """Reject implausibly large numbers before they enter statistics."""
    for verdict in assessment.verdicts:
        for shown in verdict.indicators:
            value = shown.value
            numbers = (value.estimate, value.low, value.high, shown.scatter, shown.limit, shown.emergency)
            largest = max(abs(number) for number in (*numbers, shown.windows) if number is not None)
            if largest > _LARGEST_VALUE or not 0 <= (verdict.vehicle or 0) <= 255:
                raise MavhumsError(f"{path}: {verdict.actuator[:60]}: numbers beyond all measure", _AGAIN)


def _words(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
