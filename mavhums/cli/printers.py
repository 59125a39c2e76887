"""Prints the outcomes of ``mavhums analyse`` as they come, and finds its exit code; opens recordings."""

from __future__ import annotations

import json
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import indent
from types import TracebackType
from typing import TYPE_CHECKING, Self

import click

from mavhums.cli.output import complain, say, say_json
from mavhums.core.about import EPILOG
from mavhums.core.errors import GRAVEST_FIRST, ExitCode, MavhumsError, MissingExtraError

if TYPE_CHECKING:
    from mavhums.app.many import Outcome
    from mavhums.results.assessment import Assessment
    from mavhums.show.terminal import Line

__all__ = ["JsonPrinter", "OutcomePrinter", "TablePrinter", "open_recordings", "recordings_of"]


class OutcomePrinter(ABC):
    """Prints each outcome; a context, so that the output is complete even after an interruption."""

    def __init__(self) -> None:
        self._codes: set[ExitCode] = set()

    def show(self, outcome: Outcome) -> None:
        """Print an outcome."""
        if outcome.assessment is not None:
            self._codes.add(outcome.assessment.exit_code)
            self._judged(outcome.log, outcome.assessment)
        if outcome.error is not None:
            self._codes.add(ExitCode.ERROR)
            complain(outcome.error)
            self._failed(outcome.log, outcome.error)

    def exit_code(self, *, losses: bool) -> ExitCode:
        """Return the gravest of all outcomes; ``losses`` if the history was read with losses."""
        codes = self._codes | ({ExitCode.READ_WITH_LOSSES} if losses else set())
        return next((code for code in GRAVEST_FIRST if code in codes), ExitCode.OK)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    @abstractmethod
    def _end(self) -> None: ...

    @abstractmethod
    def _judged(self, log: Path, assessment: Assessment) -> None: ...

    @abstractmethod
    def _failed(self, log: Path, error: MavhumsError) -> None: ...


class TablePrinter(OutcomePrinter):
    """Prints a table per log; of several, what is not normal under each log's name, and one table at the end.

    Parameters
    ----------
    recordings
        Path of each log's recording.
    several
        Whether there are several logs.
    verbose
        Whether each log is shown with every reason and finding.
    """

    def __init__(self, recordings: Mapping[Path, Path], *, several: bool, verbose: bool = False) -> None:
        super().__init__()
        self._recordings = recordings
        self._several = several
        self._whole, self._verbose = verbose or not several, verbose
        self._lines: list[Line] = []

    def _judged(self, log: Path, assessment: Assessment) -> None:
        from rich.console import Console

        from mavhums.show import render
        from mavhums.show.terminal import line_of, render_findings
        from mavhums.show.viewer_program import viewer_command

        self._lines.append(line_of(log, assessment))
        title = f"=== {assessment.log.path} ==="
        if self._several and self._whole:
            say(title)
        if self._whole:
            render(assessment, Console(), verbose=self._verbose)
        else:
            render_findings(assessment, Console(), title)
        recording = self._recordings.get(log)
        if recording is not None:
            say(f"recording: {recording}   open it with: {viewer_command()} {recording}\n")
        sys.stdout.flush()

    def _failed(self, log: Path, error: MavhumsError) -> None:
        """Print no more than the error."""
        from mavhums.show.terminal import line_of

        self._lines.append(line_of(log, error))

    def _end(self) -> None:
        """Print the table of several logs; after an interruption it holds what was judged."""
        if not self._several or not self._lines:
            return
        from rich.console import Console

        from mavhums.show.terminal import render_many

        render_many(self._lines, Console())
        if not self._whole:
            say("--verbose shows all of each log, --json every figure.")
        say(EPILOG)


class JsonPrinter(OutcomePrinter):
    """Prints one assessment as it is; several, or a failure, as one object.

    The object is printed piece by piece: of many logs the assessments would not fit into memory, and after an
    interruption it is complete with what was judged.
    """

    def __init__(self, *, several: bool) -> None:
        super().__init__()
        self._several = several
        self._opened = False
        self._failures: list[dict[str, str]] = []

    def _judged(self, log: Path, assessment: Assessment) -> None:
        if not self._several:
            say_json(assessment.to_json())
            return
        separator = ",\n" if self._opened else f"{self._object()[0]}\n"
        self._opened = True
        content = json.dumps(json.loads(assessment.to_json()), indent=2, ensure_ascii=False)
        say_json(separator + indent(content, "    "), nl=False)
        sys.stdout.flush()

    def _failed(self, log: Path, error: MavhumsError) -> None:
        self._failures.append({"log": str(log), "problem": error.problem, "remedy": error.remedy})

    def _end(self) -> None:
        if not self._several and not self._failures:
            return
        head, tail = self._object()
        say_json(f"\n  {tail}" if self._opened else head + tail)

    def _object(self) -> tuple[str, str]:
        """Return the object of the schema, up to the assessments and from their end on."""
        from mavhums.results.assessment import SCHEMA

        content = {"schema": SCHEMA, "assessments": [], "failures": self._failures}
        head, _, tail = json.dumps(content, indent=2, ensure_ascii=False).partition('"assessments": []')
        return f'{head}"assessments": [', f"]{tail}"


def recordings_of(logs: Sequence[Path], rrd: Path | None) -> dict[Path, Path]:
    """Return the path of each log's recording.

    Raises
    ------
    UsageError
        If two logs would share a recording.
    MavhumsError
        If several recordings need a folder that cannot be made.
    """
    if rrd is None:
        return {}
    if len(logs) == 1:
        return {logs[0]: rrd}
    names = [log.stem for log in logs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise click.UsageError(f"two logs named {twice!r} would share one recording; analyse them one by one")
    try:
        rrd.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MavhumsError(f"{rrd}: {error.strerror}", "with several logs --rrd names a folder") from error
    return {log: rrd / f"{log.stem}.rrd" for log in logs}


def open_recordings(recordings: Sequence[Path]) -> None:
    """Open recordings in the Rerun viewer; warn if it cannot be started, for the verdicts stand."""
    import subprocess

    from mavhums.show.viewer_program import viewer_program

    try:
        subprocess.Popen([str(viewer_program()), *map(str, recordings)])
    except MissingExtraError as error:
        complain(error)
    except OSError as error:
        complain(MavhumsError("the Rerun viewer cannot be started", error.strerror or str(error)))
