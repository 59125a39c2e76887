"""What an assistant may ask of the logs in the folders that a user opens to it; nothing is written."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from mavhums.app.analysis import analyse
from mavhums.app.inspection import inspect_log
from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError
from mavhums.results.assessment import SCHEMA, Assessment
from mavhums.show.answer import blocks
from mavhums.show.blocks import Finding, Headline, Listing
from mavhums.show.markdown_report import draw
from mavhums.show.words import name

_REMEMBERED: Final = 20  # an assistant asks about one log again and again
_NAMED: Final = 20
_LETTERS: Final = 200  # of a name that is refused


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Which logs may be read.

    Attributes
    ----------
    folders
        Their folders; what lies outside, also by a symbolic link, is refused.
    logs
        Most logs of one request: each may take a minute.
    log_bytes
        Size of a log, unpacked.
    """

    folders: Sequence[Path] = (Path(),)
    logs: int = 20
    log_bytes: int = 1_000_000_000


class LogAssistant:
    """Answers requests about logs as JSON objects or in words.

    Parameters
    ----------
    reach
        Which logs may be read.
    options
        How they are judged, and the store with which they are compared.

    Examples
    --------
    >>> assistant = LogAssistant(Reach(), Options(airframe="paper"))
    >>> assistant.analyse(["flight.tlog"])["assessments"][0]["airframe"]
    'paper'
    >>> print(assistant.explain("flight.tlog", "elevator")[:21])
    # EMERGENCY: elevator
    """

    def __init__(self, reach: Reach, options: Options | None = None) -> None:
        self._reach = replace(reach, folders=[folder.resolve() for folder in reach.folders])
        self._settings = Settings.read(replace(options or Options(), keep=False))
        self._judged = lru_cache(_REMEMBERED)(self._judge)

    def inspect(self, log: str) -> dict[str, Any]:
        """Return what a log contains, what it allows to judge, and how to record what is missing."""
        path = self._found(log)
        airframe, dialect = self._settings.engine.airframe, self._settings.engine.dialect
        check = self._bounded(path)
        return _object(inspect_log(path, airframe=airframe, dialect=dialect, progress=check).to_json())

    def analyse(self, logs: Sequence[str]) -> dict[str, Any]:
        """Return the verdicts on logs, and why a log could not be judged."""
        if not 1 <= len(logs) <= self._reach.logs:
            raise MavhumsError(f"{len(logs)} logs in one request", f"name 1 to {self._reach.logs}")
        assessments, failures = [], []
        for log in logs:
            try:
                assessments.append(_object(self._assessment(log).to_json()))
            except MavhumsError as error:
                failures.append({"log": log, "problem": error.problem, "remedy": error.remedy})
        return {"schema": SCHEMA, "assessments": assessments, "failures": failures}

    def explain(self, log: str, subject: str) -> str:
        """Return in words what was found about one subject of a log: reason, evidence, advice."""
        assessment = self._assessment(log)
        named = {name(verdict, assessment).casefold(): verdict for verdict in assessment.ranked()}
        wanted = subject.casefold()
        verdicts = [v for title, v in named.items() if wanted in (title, v.actuator.casefold())]
        if not verdicts:
            known = ", ".join([*named][:_NAMED])
            raise MavhumsError(f"{log}: no verdict on {subject[:_LETTERS]!r}", f"one of: {known}")
        shown = blocks(assessment.model_copy(update={"verdicts": tuple(verdicts)}))
        return draw(block for block in shown if isinstance(block, Headline | Finding | Listing))

    def trend(self, aircraft: str | None = None) -> dict[str, Any]:
        """Return the trends of an aircraft's actuators over its kept flights."""
        from mavhums.flights import reports

        store = self._settings.store
        if store is None:
            raise MavhumsError("no flights are kept yet", "keep a first one: mavhums analyse LOG --keep")
        return _object(reports.trend(store.address, aircraft).to_json())

    def _found(self, log: str) -> Path:
        """Return the file of a log within the folders."""
        folders = self._reach.folders
        try:
            places = [(folder / log).resolve() for folder in folders]
            inside = [place for place in places if any(map(place.is_relative_to, folders))]
            path = next((place for place in inside if place.is_file()), None)
        except (OSError, ValueError, RuntimeError) as error:
            raise MavhumsError(f"{log[:_LETTERS]!r}: no name of a file", "check the name") from error
        if path is not None:
            return path
        allowed = ", ".join(map(str, folders))
        if not inside:
            raise MavhumsError(
                f"{log[:_LETTERS]}: lies outside of {allowed}", "start `mavhums mcp` with --folder"
            )
        raise MavhumsError(f"{log[:_LETTERS]}: no such file in {allowed}", "check the name")

    def _bounded(self, path: Path) -> Any:
        """Return what ends the reading of a log that is too large."""
        most = self._reach.log_bytes

        def check(size: int) -> None:
            if size > most:
                remedy = "judge it with `mavhums analyse`, or start `mavhums mcp` with --max-mb"
                raise MavhumsError(f"{path}: larger than {most / 1e6:,.0f} MB", remedy)

        check(path.stat().st_size)
        return check

    def _assessment(self, log: str) -> Assessment:
        path = self._found(log)
        state = path.stat()
        return self._judged(path, state.st_size, state.st_mtime_ns)

    def _judge(self, path: Path, *_: int) -> Assessment:
        return analyse(path, self._settings, progress=self._bounded(path))


def _object(text: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(text)
    return found
