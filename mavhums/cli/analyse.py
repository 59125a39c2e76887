"""The commands ``analyse`` and ``report``."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mavhums.cli.keeping import check_baseline_dates, divided, indexed_history, judged_in_store
from mavhums.cli.options import (
    AIRCRAFT,
    AIRCRAFT_TABLE,
    AIRFRAME,
    BASELINE_FROM,
    DECIDE,
    DIALECT,
    FALSE_ALARMS,
    HISTORY,
    JOBS,
    JSON,
    KEEP,
    KEY,
    LOG,
    LOGS,
    MODEL,
    PATH,
    gathered,
)
from mavhums.cli.output import announce_compiling, reading, say
from mavhums.cli.printers import JsonPrinter, OutcomePrinter, TablePrinter, open_recordings, recordings_of
from mavhums.core.about import EPILOG

if TYPE_CHECKING:
    from mavhums.app.settings import Options

__all__ = ["analyse", "report"]


@click.command(short_help="Judge every actuator and control axis in logs.", epilog=EPILOG)
@LOGS
@AIRFRAME
@MODEL
@DECIDE
@DIALECT
@FALSE_ALARMS
@HISTORY
@KEEP
@BASELINE_FROM
@AIRCRAFT
@AIRCRAFT_TABLE
@KEY
@JSON
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
@gathered
def analyse(
    options: Options,
    logs: tuple[Path, ...],
    history: Path | str | None,
    keep: bool,
    dates: tuple[tuple[str | None, datetime], ...],
    as_json: bool,
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
    With --history, each actuator is also compared with its own first flights; --keep adds this flight to
    them, so that one command after each landing keeps the history. Give several logs oldest first.
    The flight of another aircraft than those in DIR is refused. A STORE of `mavhums fleet scan` holds many
    aircraft: each log is compared with the flights of its own, and --keep adds it as a scan does.

    \b
    Exit codes, the first that applies:
      2 usage    11 an emergency    10 degraded    1 a log that cannot be read
      12 undecided    3 log or history read with losses    0 all normal
    """
    from mavhums.app.many import Batch, analyse_many
    from mavhums.app.settings import Settings

    if open_viewer and rrd is None:
        raise click.UsageError("--open needs --rrd OUT")
    if keep and history is None:
        raise click.UsageError("--keep needs --history DIR")
    check_baseline_dates(dates, history)
    folder, store = divided(history)
    history_before = indexed_history(folder, may_be_new=keep)
    settings = Settings.read(replace(options, history=history_before, since=dict(dates)))
    recordings = recordings_of(logs, rrd)
    batch = Batch(
        jobs=jobs,
        keep=folder if keep else None,
        recordings=recordings,
        position=not no_position,
        progress=reading,
        prepare=announce_compiling,
    )
    several = len(logs) > 1
    printer: OutcomePrinter = (
        JsonPrinter(several=several)
        if as_json
        else TablePrinter(recordings, several=several, verbose=verbose)
    )
    with printer:
        judged = (
            analyse_many(logs, settings, batch)
            if store is None
            else judged_in_store(logs, store, options, batch, keep=keep)
        )
        for outcome in judged:
            printer.show(outcome)
    written = [recording for recording in recordings.values() if recording.exists()]
    if open_viewer and written:
        open_recordings(written)
    unread = bool(settings.history.errors)
    raise SystemExit(printer.exit_code(losses=unread))


@click.command(short_help="Write the verdicts on a log as one HTML file.", epilog=EPILOG)
@LOG
@click.option("-o", "--output", required=True, type=PATH, metavar="OUT", help="The page, as report.html.")
@AIRFRAME
@MODEL
@DECIDE
@DIALECT
@FALSE_ALARMS
@HISTORY
@BASELINE_FROM
@AIRCRAFT
@AIRCRAFT_TABLE
@KEY
@gathered
def report(
    options: Options,
    log: Path,
    output: Path,
    history: Path | str | None,
    dates: tuple[tuple[str | None, datetime], ...],
) -> None:
    """Write the verdicts on LOG with their evidence as one HTML file, to mail or to file.

    It opens without a network, prints on paper, and holds no script. LOG may be - for the standard input.
    Exit codes are those of analyse.
    """
    from mavhums.app.analysis import write_report
    from mavhums.app.settings import Settings

    check_baseline_dates(dates, history)
    folder, store = divided(history)
    settings = Settings.read(replace(options, history=indexed_history(folder), since=dict(dates)))
    if store is not None:
        from mavhums.fleet import against

        settings = against(log, store, settings)
    with reading(log) as progress:
        assessment = write_report(log, output, settings, progress=progress)
    say(assessment.summary())
    say(f"report: {output}   open it in a browser")
    raise SystemExit(assessment.exit_code)
