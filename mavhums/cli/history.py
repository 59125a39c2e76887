"""The earlier flights of an aircraft: opened, judged against, kept; and the command ``trend`` over them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Never

import click

from mavhums.cli.options import AIRCRAFT_TABLE, BASELINE_FROM, JSON, PATH, Dates
from mavhums.cli.output import complain, say, say_json, steps
from mavhums.core.about import EPILOG
from mavhums.core.errors import ExitCode, MavhumsError

if TYPE_CHECKING:
    from mavhums.app.analysis import Failed, Judged
    from mavhums.app.many import Batch
    from mavhums.app.settings import History, Options
    from mavhums.flights.history import FlightHistory
    from mavhums.results.assessment import Assessment
    from mavhums.results.standing import TrendReport

_SHOWN_NOTICES = 5


TREND_TABLE = click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="OUT",
    help="Also write a row per flight and indicator to a table that ends in .csv or .parquet.",
)


def divided(history: Path | str | None) -> tuple[Path | None, Path | str | None]:
    """Return the folder of flights or the store of a fleet that a history is; one of the two is None."""
    from mavhums.flights.history import is_store  # not before: --help loads nothing heavy

    if history is None or not is_store(history):
        return None if history is None else Path(history), None
    return None, history


def check_baseline_dates(dates: Sequence[Any], history: Path | str | None) -> None:
    """Refuse dates of repairs without a history, and with a store, which keeps them itself.

    Raises
    ------
    UsageError
        If dates are given nevertheless.
    """
    if dates and history is None:
        raise click.UsageError("--baseline-from needs --history DIR")
    if dates and divided(history)[1] is not None:
        name, date = dates[0]
        entry = f"AIRCRAFT/{name or ''}={date:%Y-%m-%d}" if isinstance(date, datetime) else "DATE"
        raise click.UsageError(
            f"{history} keeps the dates of repairs: mavhums fleet repairs {history} --add {entry}"
        )


def indexed_history(folder: Path | None, *, may_be_new: bool = False) -> History:
    """Open a folder of flights by its index; print on standard error which files could not be read."""
    from mavhums.flights.history import FlightHistory

    if folder is None or (may_be_new and not folder.exists()):
        return FlightHistory()
    from mavhums.flights.folder import FlightFolder

    with steps("reading the flights before") as progress:
        history = FlightFolder(folder, progress=progress)
    report_losses(history)
    return history


def report_losses(history: History) -> None:
    """Print on standard error which files of a history could not be read, and its first notices."""
    for error in history.errors:
        complain(error)
    for notice in history.notices[:_SHOWN_NOTICES]:
        say(f"mavhums: {notice}", err=True)
    if len(history.notices) > _SHOWN_NOTICES:
        say(f"mavhums: and {len(history.notices) - _SHOWN_NOTICES} more notices", err=True)


def judged_in_store(
    logs: Sequence[Path], store: Path | str, options: Options, batch: Batch, *, keep: bool
) -> Iterator[Judged | Failed]:
    """Judge logs against the flights of their aircraft in a store, and yield each outcome.

    With ``keep``, the logs are put into the store first, as ``fleet scan`` does.
    """
    from mavhums.app.analysis import Judged, judge
    from mavhums.fleet import landing

    if keep:
        workers = batch.jobs if batch.jobs and batch.jobs > 1 else 0
        with steps("putting the logs into the store") as progress:
            outcomes = landing.keep(logs, store, options, workers=workers, progress=progress)
    else:
        outcomes = _compared(logs, store, options)
    for outcome in outcomes:
        sinks = batch.sinks.get(outcome.log, ())
        if sinks and isinstance(outcome, Judged):
            left = judge(outcome.log, landing.against(outcome.log, store, options), sinks)
            yield outcome._replace(error=left.error)
        else:
            yield outcome


def _compared(logs: Sequence[Path], store: Path | str, options: Options) -> Iterator[Judged | Failed]:
    from mavhums.app.analysis import Failed, Judged
    from mavhums.fleet import landing

    for log in logs:
        try:
            yield Judged(log, landing.analyse(log, store, options))
        except MavhumsError as error:
            yield Failed.of(log, error)


class SessionKeeper:
    """Puts the recording of a live session among the earlier flights.

    Parameters
    ----------
    judging
        Options by which the recording is judged.
    history
        Folder of an aircraft's flights, or store of a fleet.
    """

    def __init__(self, judging: Options, history: Path | str) -> None:
        self._judging = judging
        self._folder, self._store = divided(history)

    def __call__(self, assessment: Assessment) -> ExitCode:
        """Keep the recording of a session; return the exit code of the command."""
        from mavhums.app.many import Batch, analyse_many

        log, code = Path(assessment.log.path or ""), assessment.exit_code
        try:
            if not log.is_file() or not log.stat().st_size:
                remedy = "check the link: the report above lists what was received"
                raise MavhumsError(f"{log}: nothing was recorded, so nothing is kept", remedy)
            if self._store is not None:
                judged = judged_in_store([log], self._store, self._judging, Batch(jobs=1), keep=True)
            else:
                folder = self._folder if self._folder and self._folder.exists() else None
                batch = Batch(jobs=1, keep=self._folder)
                judged = analyse_many([log], replace(self._judging, history=folder), batch)
            for outcome in judged:
                if outcome.error is not None:
                    raise outcome.error
        except MavhumsError as error:
            complain(error)
            return code if code in (ExitCode.EMERGENCY, ExitCode.DEGRADED) else ExitCode.ERROR
        say(f"mavhums: {log} is kept in {self._store or self._folder}", err=True)
        return code


def live_judging(options: Options, given: dict[str, Any]) -> tuple[Options, SessionKeeper | None]:
    """Take the history and what is kept out of what was ``given`` to ``live``.

    Returns
    -------
    tuple
        By what the links are judged, a store replaced by the flights of the aircraft in it; and what keeps
        the recording, if it is to be kept.

    Raises
    ------
    UsageError
        If another option is missing.
    """
    from mavhums.flights.aircraft_table import AircraftTable, load_aircraft_table

    keep, history, dates = (given.pop(name) for name in ("keep", "history", "dates"))
    aircraft, file = options.aircraft, options.aircraft_table
    check_baseline_dates(dates, history)
    store = divided(history)[1]
    if keep and (history is None or given["record"] is None):
        raise click.UsageError("--keep needs --history DIR and --record FILE")
    if (store is None) != (aircraft is None):
        missing = "--aircraft NAME: the store contains several" if store else "--history STORE for --aircraft"
        raise click.UsageError(f"name {missing}")
    table = (
        file if isinstance(file, AircraftTable) else load_aircraft_table(file) if file else AircraftTable()
    )
    judging = replace(options, aircraft=None, aircraft_table=table, since=dict(dates))
    kept = replace(judging, aircraft=f"={aircraft}" if aircraft else None)
    if store is not None and aircraft is not None:
        from mavhums.fleet import past
        from mavhums.flights.aircraft import latest

        now = datetime.now(UTC)
        flown = past(store, aircraft, now)
        since = latest(flown.since, table.since(aircraft, now))
        judging = replace(judging, history=flown.history, since=since)
    elif history is not None and not (keep and not Path(history).exists()):
        judging = replace(judging, history=history)
    return judging, SessionKeeper(kept, history) if keep else None


@click.command(short_help="Show each actuator over its flights.", epilog=EPILOG)
@click.argument("folder", metavar="DIR", type=PATH)
@click.option(
    "--actuator", "actuators", multiple=True, metavar="NAME", help="Only this one; can be repeated."
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    default=("friction", "effectiveness"),
    show_default=True,
    metavar="NAME",
    help="What wears; can be repeated; 'all' for every fault that the flights show.",
)
@BASELINE_FROM
@AIRCRAFT_TABLE
@JSON
@TREND_TABLE
def trend(
    folder: Path,
    actuators: tuple[str, ...],
    faults: tuple[str, ...],
    dates: Dates,
    aircraft_table: Path | None,
    as_json: bool,
    output: Path | None,
) -> None:
    """Show the trend of each actuator over the flights in DIR, and its remaining useful life (RUL).

    DIR holds an aircraft's assessments, as `mavhums analyse LOG --history DIR --keep` puts them there, or
    `mavhums analyse LOG --json`. Keep one folder for each aircraft: a folder with flights of several is
    refused. Subfolders are not read.

    The RUL is the number of flights until a straight line reaches the emergency limit, with a 95 % interval.
    Where the flights do not support one, the reason is given. After a repair, restart the baseline
    with --baseline-from.

    \b
    Exit codes, the first that applies:
      2 usage    1 error    11 an actuator's last flight was an emergency
      10 its last flight was degraded, or it has an RUL
      12 its last flight was undecided, or no flight shows the fault
      3 files of the folder could not be read    0 none of these
    """
    from mavhums.core.output import writer_for
    from mavhums.flights.aircraft_table import load_aircraft_table
    from mavhums.flights.folder import read_history
    from mavhums.flights.trends import own_trend_report

    if output is not None:
        writer_for(output)
    with steps("reading the flights before") as progress:
        history = read_history(folder, progress=progress)
    report_losses(history)
    wanted = () if "all" in faults else faults
    table = load_aircraft_table(aircraft_table) if aircraft_table else None
    report = own_trend_report(history, table, actuators=actuators, faults=wanted, since=dict(dates))
    _check_names_known(folder, history, [*actuators, *(name for name, _ in dates if name)], wanted)
    end_with_trends(report, output, as_json=as_json)


def _check_names_known(
    folder: Path, history: FlightHistory, actuators: list[str], faults: Sequence[str]
) -> None:
    """Refuse misspelt names: those that occur in no flight."""
    verdicts = [verdict for flight in history.flights for verdict in flight.assessment.verdicts]
    known = {verdict.actuator for verdict in verdicts}
    shown = {indicator.fault for verdict in verdicts for indicator in verdict.indicators}
    for what, names, there in (
        ("actuator", actuators, known),
        ("fault", faults, shown | {"friction", "effectiveness"}),
    ):
        for name in names:
            if name not in there:
                remedy = f"the flights show: {', '.join(sorted(there)) or 'none'}"
                raise MavhumsError(f"{folder}: no flight has the {what} {name!r}", remedy)


def end_with_trends(report: TrendReport, output: Path | None, *, as_json: bool) -> Never:
    """Write the trends to a table if wanted, print them, and end with their exit code."""
    if output is not None:
        from mavhums.core.output import writer_for, written_whole
        from mavhums.results.standing import to_frame

        with written_whole(output) as temporary, writer_for(output)(temporary) as table:
            table.write(to_frame(report.trends))
    if as_json:
        say_json(report.to_json())
    else:
        from rich.console import Console

        from mavhums.show.terminal import draw
        from mavhums.show.trend import trend_blocks

        draw(trend_blocks(report), Console())
    raise SystemExit(report.exit_code)
