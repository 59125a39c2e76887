"""The command line. Commands import their modules when they run, so that ``--help`` is fast."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mavhums.cli.ending import heed_signals, interrupts_end_silently
from mavhums.cli.fleet import fleet
from mavhums.cli.groups import Grouped
from mavhums.cli.judging import TellsJson, TellsTables, Told, open_recordings, recordings_of
from mavhums.cli.keeping import divided, hold_dates, judged_in_store
from mavhums.cli.learn import precedents, study, train
from mavhums.cli.live import live
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
)
from mavhums.cli.output import complain, say, say_json, sound_output
from mavhums.cli.progress import reading
from mavhums.cli.report import report
from mavhums.cli.serve import serve
from mavhums.cli.tools import export, model, profile
from mavhums.cli.trend import indexed_history, trend
from mavhums.cli.warm_up import announce_compiling, warm_up
from mavhums.core.collecting import collect_seldom
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.notice import EPILOG
from mavhums.core.version import __version__

if TYPE_CHECKING:
    from mavhums.report.assessment import Decide

__all__ = ["main"]


@click.group(
    cls=Grouped,
    headings={
        "Judge": ("analyse", "report", "serve", "live"),
        "Look": ("inspect", "export"),
        "Over flights": ("trend", "fleet"),
        "Set up": ("profile", "warm-up"),
        "Models": ("model", "train", "precedents", "study"),
    },
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="mavhums")
def cli() -> None:
    """Health of a UAV's servos and control surfaces from the log it already records.

    \b
    Start here:
      mavhums analyse flight.tlog                  the verdict per actuator
      mavhums analyse flight.tlog --rrd flight.rrd the same, and a Rerun recording
      mavhums report flight.tlog -o report.html    the same as one HTML file
      mavhums serve                                the same in the browser: drop logs on a page
      mavhums trend flights                        each actuator over its flights
      mavhums live udpin:14550                     the same verdicts while it flies
      mavhums inspect flight.tlog                  what the log holds, and what is missing
      mavhums profile new flight.tlog -o mine.toml a profile of your aircraft, to be filled in
    """


@cli.command(short_help="Judge every actuator and control axis in logs.", epilog=EPILOG)
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
@click.option("--verbose", is_flag=True, help="Show every reason and finding, and the servos' use.")
@click.option("--open", "open_viewer", is_flag=True, help="Open the recording in the Rerun viewer.")
def analyse(
    logs: tuple[Path, ...],
    airframe: str | None,
    model: str | None,
    decide: Decide,
    dialect: Path | None,
    false_alarms: float,
    history: Path | str | None,
    keep: bool,
    dates: tuple[tuple[str | None, datetime], ...],
    aircraft: str | None,
    aircraft_table: Path | None,
    key: Path | None,
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
    With --history, each actuator is also held against its own first flights; --keep makes this flight one of
    them, so that one command after each landing is all the book-keeping. Give several logs oldest first.
    The flight of another aircraft than those in DIR is refused. A STORE of `mavhums fleet scan` holds many
    aircraft: each log is held against the flights of its own, and --keep puts it in as a scan does.

    \b
    Exit codes, the first that applies:
      2 usage    11 an emergency    10 degraded    1 a log that cannot be read
      12 undecided    3 log or history read with losses    0 all normal
    """
    from mavhums.actuator.profile import load_airframe
    from mavhums.app.many import Batch, analyse_many
    from mavhums.app.options import Options
    from mavhums.learn import load_model
    from mavhums.log.mavlink.signing import load_key

    if open_viewer and rrd is None:
        raise click.UsageError("--open needs --rrd OUT")
    if keep and history is None:
        raise click.UsageError("--keep needs --history DIR")
    hold_dates(dates, history)
    folder, store = divided(history)
    options = Options(
        airframe=load_airframe(airframe) if airframe else None,
        model=load_model(model) if model else None,
        decide=decide,
        history=indexed_history(folder, may_be_new=keep),
        since=dict(dates),
        aircraft=aircraft,
        aircraft_table=aircraft_table,
        false_alarms=false_alarms,
        dialect=dialect,
        key=load_key(key) if key else None,
    )
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
    told: Told = (
        TellsJson(several=several) if as_json else TellsTables(recordings, several=several, verbose=verbose)
    )
    with told:
        judged = (
            analyse_many(logs, options, batch)
            if store is None
            else judged_in_store(logs, store, options, batch, keep=keep)
        )
        for outcome in judged:
            told.tell(outcome)
    written = [recording for recording in recordings.values() if recording.exists()]
    if open_viewer and written:
        open_recordings(written)
    unread = bool(options.flights().errors)
    raise SystemExit(told.exit_code(losses=unread))


@cli.command(short_help="Tell what a log allows to judge, and what it lacks.")
@LOG
@AIRFRAME
@DIALECT
@click.option("--messages", is_flag=True, help="List the messages and named values, with their rates.")
@JSON
def inspect(log: Path, airframe: str | None, dialect: Path | None, messages: bool, as_json: bool) -> None:
    """Tell what LOG allows to judge, and what it lacks.

    First what can be judged, then each vehicle with its telemetry tier, what is missing and how to record
    it, and the log's losses.

    LOG may be - for the standard input.
    """
    from mavhums.app.inspection import inspect_log

    with reading(log) as progress:
        inspection = inspect_log(log, airframe=airframe, dialect=dialect, progress=progress)
    if as_json:
        say_json(inspection.to_json())
    else:
        from rich.console import Console

        from mavhums.show.inspection import render_inspection

        render_inspection(inspection, Console(), messages=messages)
    raise SystemExit(ExitCode.READ_WITH_LOSSES if inspection.losses.any else ExitCode.OK)


for _command in (
    report,
    serve,
    live,
    trend,
    fleet,
    train,
    precedents,
    study,
    export,
    model,
    profile,
    warm_up,
):
    cli.add_command(_command)


def main() -> None:
    """Run the command line; an error that the user can correct is one line with a remedy."""
    heed_signals()
    collect_seldom()
    announce_compiling()
    with sound_output():
        try:
            cli.main(prog_name="mavhums", standalone_mode=False)
        except MavhumsError as error:
            complain(error)
            sys.exit(ExitCode.ERROR)
        except click.ClickException as error:
            error.show()
            sys.exit(ExitCode.USAGE)
        except (click.Abort, KeyboardInterrupt):
            say("mavhums: stopped; no output was left half-written", err=True)
            sys.exit(130)
        finally:
            interrupts_end_silently()
