"""The command ``trend``: an aircraft's actuators over its flights."""

from __future__ import annotations

from pathlib import Path

import click

from mavhums.cli.options import FLEET_STORE, JSON, PATH
from mavhums.cli.output import say_json
from mavhums.core.about import EPILOG


@click.command(short_help="Show each actuator over its flights.", epilog=EPILOG)
@click.argument("aircraft", required=False)
@FLEET_STORE
@click.option(
    "--actuator", "actuators", multiple=True, metavar="NAME", help="Only this one; can be repeated."
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    default=("friction", "effectiveness"),
    metavar="NAME",
    help="What wears; can be repeated; 'all' for every fault that the flights show.",
)
@JSON
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="OUT",
    help="Also write a row per flight and indicator to a table that ends in .csv or .parquet.",
)
def trend(
    aircraft: str | None,
    store: str,
    actuators: tuple[str, ...],
    faults: tuple[str, ...],
    as_json: bool,
    output: Path | None,
) -> None:
    """Show the trend of each actuator of AIRCRAFT over its flights, and its remaining useful life (RUL).

    AIRCRAFT may be left out where the store has one only.

    The RUL is the number of flights until a straight line reaches the emergency limit, with a 95 % interval.
    Where the flights do not support one, the reason is given. After a repair, restart the baseline
    with `mavhums fleet repairs --add`.

    \b
    Exit codes, the first that applies:
      2 usage    1 error    11 an actuator's last flight was an emergency
      10 its last flight was degraded, or it has an RUL
      12 its last flight was undecided, or no flight shows the fault
      0 none of these
    """
    from mavhums.core.output import writer_for, written_whole
    from mavhums.flights import reports

    writer = writer_for(output) if output is not None else None
    wanted = () if "all" in faults else faults
    report = reports.trend(store, aircraft, actuators=actuators, faults=wanted)
    if output is not None and writer is not None:
        with written_whole(output) as temporary, writer(temporary) as table:
            table.write(report.to_frame())
    if as_json:
        say_json(report.to_json())
    else:
        from rich.console import Console

        from mavhums.show.terminal import draw
        from mavhums.show.trend import trend_blocks

        draw(trend_blocks(report), Console())
    raise SystemExit(report.exit_code)
