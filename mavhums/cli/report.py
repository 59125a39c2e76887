"""The command ``report``: writes the result as one HTML file."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mavhums.cli.keeping import divided, hold_dates
from mavhums.cli.options import (
    AIRCRAFT,
    AIRCRAFT_TABLE,
    AIRFRAME,
    BASELINE_FROM,
    DECIDE,
    DIALECT,
    FALSE_ALARMS,
    HISTORY,
    KEY,
    LOG,
    MODEL,
    PATH,
)
from mavhums.cli.output import say
from mavhums.cli.progress import reading
from mavhums.cli.trend import indexed_history
from mavhums.core.notice import EPILOG

if TYPE_CHECKING:
    from mavhums.report.assessment import Decide

__all__ = ["report"]


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
def report(
    log: Path,
    output: Path,
    airframe: str | None,
    model: str | None,
    decide: Decide,
    dialect: Path | None,
    false_alarms: float,
    history: Path | str | None,
    dates: tuple[tuple[str | None, datetime], ...],
    aircraft: str | None,
    aircraft_table: Path | None,
    key: Path | None,
) -> None:
    """Write the verdicts on LOG with their evidence as one HTML file, to mail or to file.

    It opens without a network, prints on paper, and holds no script. LOG may be - for the standard input.
    Exit codes are those of analyse.
    """
    from mavhums.app.options import Options
    from mavhums.app.report import write_report

    hold_dates(dates, history)
    folder, store = divided(history)
    options = Options(
        airframe=airframe,
        model=model,
        decide=decide,
        history=indexed_history(folder),
        since=dict(dates),
        aircraft=aircraft,
        aircraft_table=aircraft_table,
        false_alarms=false_alarms,
        dialect=dialect,
        key=key,
    )
    if store is not None:
        from mavhums.fleet import against

        options = against(log, store, options)
    with reading(log) as progress:
        assessment = write_report(log, output, options, progress=progress)
    say(assessment.summary())
    say(f"report: {output}   open it in a browser")
    raise SystemExit(assessment.exit_code)
