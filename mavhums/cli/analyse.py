"""The commands ``analyse`` and ``report``; the printers of their outcomes, which find the exit code."""

from __future__ import annotations

import json
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING

import click

from mavhums.cli.options import JOBS, JSON, LOG, LOGS, PATH, judging
from mavhums.cli.output import complain, draw, reading, say, say_json
from mavhums.core.about import EPILOG
from mavhums.core.errors import GRAVEST_FIRST, ExitCode, MavhumsError, MissingExtraError

if TYPE_CHECKING:
    from mavhums.app.analysis import Failed, Judged
    from mavhums.app.settings import Options
    from mavhums.results.assessment import Assessment
    from mavhums.show.blocks import Block
    from mavhums.show.headline import LogLine


class _OutcomePrinter(ABC):
    """Prints each outcome; closed in any case, so that the output is complete even after an interruption."""

    def __init__(self) -> None:
        self._codes: set[ExitCode] = set()

    def show(self, outcome: Judged | Failed) -> None:
        """Print an outcome."""
        if outcome.assessment is not None:
            self._codes.add(outcome.assessment.exit_code)
            self._judged(outcome.log, outcome.assessment)
        if outcome.error is not None:
            self._codes.add(ExitCode.ERROR)
            complain(outcome.error)
            self._failed(outcome.log, outcome.error)

    def exit_code(self) -> ExitCode:
        """Return the gravest of all outcomes."""
        return next((code for code in GRAVEST_FIRST if code in self._codes), ExitCode.OK)

    @abstractmethod
    def close(self) -> None:
        """Print what comes after all outcomes."""

    @abstractmethod
    def _judged(self, log: Path, assessment: Assessment) -> None: ...

    @abstractmethod
    def _failed(self, log: Path, error: MavhumsError) -> None: ...


class _TablePrinter(_OutcomePrinter):
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
        self._lines: list[LogLine] = []

    def _judged(self, log: Path, assessment: Assessment) -> None:
        from mavhums.show.answer import blocks, not_normal
        from mavhums.show.headline import line_of

        self._lines.append(line_of(log, assessment))
        shown = blocks(assessment, brief=not self._verbose) if self._whole else not_normal(assessment)
        if shown:
            self._draw(shown, log if self._several else None)
        if recording := self._recordings.get(log):
            self._announce(recording)
        sys.stdout.flush()

    def _draw(self, shown: Sequence[Block], log: Path | None = None) -> None:
        """Draw blocks, under the name of a log."""
        if log is not None:
            say(f"=== {log} ===")
        draw(shown)

    def _announce(self, recording: Path) -> None:
        from mavhums.show.viewer import viewer_command

        say(f"recording: {recording}   open it with: {viewer_command()} {recording}\n")

    def _failed(self, log: Path, error: MavhumsError) -> None:
        """Print no more than the error."""
        from mavhums.show.headline import line_of

        self._lines.append(line_of(log, error))

    def close(self) -> None:
        """Print the table of several logs; after an interruption it holds what was judged."""
        if not self._several or not self._lines:
            return
        from mavhums.show.headline import many

        self._draw([many(self._lines)])
        if not self._whole:
            say("--verbose shows all of each log, --json every figure.")
        say(EPILOG)


class _MarkdownPrinter(_TablePrinter):
    """Prints the same as Markdown to publish: nothing names the sender's folders or boards."""

    def _judged(self, log: Path, assessment: Assessment) -> None:
        from mavhums.show.markdown_report import anonymous

        super()._judged(log, anonymous(assessment))

    def _draw(self, shown: Sequence[Block], log: Path | None = None) -> None:
        from mavhums.show.blocks import Headline
        from mavhums.show.markdown_report import draw

        match shown, log:
            case [Headline() as first, *rest], Path(name=name):
                shown = [first._replace(about=name), *rest]
            case _, Path(name=name):
                shown = [Headline(name), *shown]
        say(draw(shown))

    def _announce(self, recording: Path) -> None:
        pass

    def close(self) -> None:
        """Print the table with the logs' names alone."""
        self._lines = [
            line._replace(log=Path(line.log.name), what=line.what.replace(str(line.log), line.log.name))
            for line in self._lines
        ]
        super().close()


class _JsonPrinter(_OutcomePrinter):
    """Prints one assessment as it is; several, or a failure, as one object.

    The object is printed piece by piece: of many logs the assessments would not fit into memory, and after an
    interruption it is complete with what was judged.
    """

    def __init__(self, *, several: bool) -> None:
        from mavhums.results.assessment import SCHEMA

        super().__init__()
        self._several = several
        self._first = f'{{\n  "schema": {json.dumps(SCHEMA)},\n  "assessments": ['
        self._before = self._first
        self._failures: list[dict[str, str]] = []

    def show(self, outcome: Judged | Failed) -> None:
        """Print an outcome; what could not be kept is judged, and a failure beside it."""
        self._several |= outcome.error is not None
        super().show(outcome)

    def _judged(self, log: Path, assessment: Assessment) -> None:
        if not self._several:
            say_json(assessment.to_json())
            return
        content = json.dumps(json.loads(assessment.to_json()), indent=2, ensure_ascii=False)
        say_json(f"{self._before}\n{indent(content, '    ')}", nl=False)
        self._before = ","
        sys.stdout.flush()

    def _failed(self, log: Path, error: MavhumsError) -> None:
        self._failures.append({"log": str(log), "problem": error.problem, "remedy": error.remedy})

    def close(self) -> None:
        """Print the end of the object."""
        if not self._several and not self._failures:
            return
        end = f"{self._first}]" if self._before == self._first else "\n  ]"
        failures = json.dumps({"failures": self._failures}, indent=2, ensure_ascii=False)
        say_json(f"{end},{failures.removeprefix('{')}")


def _recordings_of(logs: Sequence[Path], rrd: Path | None) -> dict[Path, Path]:
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
        rrd.mkdir(0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise MavhumsError(f"{rrd}: {error.strerror}", "with several logs --rrd names a folder") from error
    return {log: rrd / f"{log.stem}.rrd" for log in logs}


def _open_recordings(recordings: Sequence[Path]) -> None:
    """Open recordings in the Rerun viewer; warn if it cannot be started, for the verdicts remain valid."""
    import subprocess

    from mavhums.show.viewer import viewer_call

    try:
        subprocess.Popen(viewer_call(*map(str, recordings)))
    except MissingExtraError as error:
        complain(error)
    except OSError as error:
        complain(MavhumsError("the Rerun viewer cannot be started", error.strerror or str(error)))


@click.command(short_help="Judge every actuator and control axis in logs.", epilog=EPILOG)
@LOGS
@judging()
@JSON
@click.option("--markdown", is_flag=True, help="Print the answer as Markdown, for a forum or an issue.")
@click.option(
    "--rrd",
    type=PATH,
    metavar="OUT",
    help="Write a Rerun recording; with several logs, OUT is a folder.",
)
@click.option("--no-position", is_flag=True, help="Leave out of the recording where the aircraft was.")
@JOBS
@click.option("--verbose", is_flag=True, help="Show every reason and finding, and servo usage.")
@click.option("--open", "open_viewer", is_flag=True, help="Open the recording in the Rerun viewer.")
def analyse(
    options: Options,
    logs: tuple[Path, ...],
    as_json: bool,
    markdown: bool,
    rrd: Path | None,
    no_position: bool,
    jobs: int | None,
    verbose: bool,
    open_viewer: bool,
) -> None:
    """Judge every actuator and control axis in each LOG: .tlog, .BIN or .ulg.

    A LOG may be packed as .gz, .xz, .bz2, .zst or .zip.

    Several logs are judged on all cores. What is not normal comes in the order given, each with its log's
    name, and at the end a table of all, worst first; --verbose shows all of each log.
    --keep puts the flight into a store, so that one command after each landing keeps an aircraft's history.
    From then on, each log is also compared with the earlier flights of its own aircraft there. Give several
    logs oldest first.

    \b
    Exit codes, the first that applies:
      2 usage    11 an emergency    10 degraded    1 a log that cannot be read
      12 undecided    3 log read with losses    0 all normal
    """
    from mavhums.app.analysis import Batch, analyse_many
    from mavhums.app.settings import Settings
    from mavhums.app.sinks import Recording

    if open_viewer and rrd is None:
        raise click.UsageError("--open needs --rrd OUT")
    if markdown and (as_json or verbose):
        raise click.UsageError("--markdown is the short answer: leave out --json and --verbose")
    settings = Settings.read(options)
    recordings = _recordings_of(logs, rrd)
    batch = Batch(
        jobs=jobs,
        sinks={log: [Recording(path, position=not no_position)] for log, path in recordings.items()},
        progress=reading,
    )
    several = len(logs) > 1
    kind = _MarkdownPrinter if markdown else _TablePrinter
    printer: _OutcomePrinter = (
        _JsonPrinter(several=several) if as_json else kind(recordings, several=several, verbose=verbose)
    )
    with closing(printer):
        kept = 0
        for outcome in analyse_many(logs, settings, batch):
            printer.show(outcome)
            kept += outcome.kept
    if kept:
        say(f"mavhums: {kept} {'log is' if kept == 1 else 'logs are'} kept in {settings.store}", err=True)
    written = [recording for recording in recordings.values() if recording.exists()]
    if open_viewer and written:
        _open_recordings(written)
    raise SystemExit(printer.exit_code())


@click.command(short_help="Write the verdicts on a log as one HTML file.", epilog=EPILOG)
@LOG
@click.option("-o", "--output", required=True, type=PATH, metavar="OUT", help="The page, as report.html.")
@judging(without=["keep"])
def report(options: Options, log: Path, output: Path) -> None:
    """Write the verdicts on LOG with their evidence as one HTML file, to mail or to file.

    It opens without a network, prints on paper, and holds no script. LOG may be - for the standard input.
    Exit codes are those of analyse.
    """
    from mavhums.app import analysis
    from mavhums.show.answer import blocks

    with reading(log) as progress:
        assessment = analysis.analyse(log, options, report=output, progress=progress)
    draw(blocks(assessment, brief=True))
    say(f"report: {output}   open it in a browser")
    raise SystemExit(assessment.exit_code)
