"""The command ``trend``."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mavhums.cli.keeping import tell_losses
from mavhums.cli.options import AIRCRAFT_TABLE, BASELINE_FROM, JSON, PATH
from mavhums.cli.output import say_json, steps
from mavhums.core.about import EPILOG
from mavhums.core.errors import MavhumsError

if TYPE_CHECKING:
    from mavhums.flights.history import FlightHistory
    from mavhums.results.standing import ActuatorTrend

__all__ = ["trend", "write_trends"]


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
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="OUT",
    help="Also write a row per flight to a table that ends in .csv or .parquet.",
)
def trend(
    folder: Path,
    actuators: tuple[str, ...],
    faults: tuple[str, ...],
    dates: tuple[tuple[str | None, datetime], ...],
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
    from mavhums.flights.trends import own_trend_report

    if output is not None:
        writer_for(output)
    history = opened_history(folder)
    wanted = () if "all" in faults else faults
    table = load_aircraft_table(aircraft_table) if aircraft_table else None
    report = own_trend_report(history, table, actuators=actuators, faults=wanted, since=dict(dates))
    _check_names_known(folder, history, [*actuators, *(name for name, _ in dates if name)], wanted)
    if output is not None:
        write_trends(output, report.trends)
    if as_json:
        say_json(report.to_json())
    else:
        from rich.console import Console

        from mavhums.show.trend import render_trends

        render_trends(report, Console())
    raise SystemExit(report.exit_code)


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


def write_trends(output: Path, trends: tuple[ActuatorTrend, ...]) -> None:
    """Write a row per flight and indicator to a table."""
    from mavhums.core.output import writer_for, written_whole
    from mavhums.results.standing import to_frame

    with written_whole(output) as temporary, writer_for(output)(temporary) as table:
        table.write(to_frame(trends))


def opened_history(folder: Path) -> FlightHistory:
    """Read a folder of flights, and print on standard error which files could not be read."""
    from mavhums.flights.folder import read_history

    with steps("reading the flights before") as progress:
        history = read_history(folder, progress=progress)
    tell_losses(history)
    return history
