"""The commands ``mavhums fleet …``: many aircraft's logs in one store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from mavhums.cli.corrections import COMMANDS
from mavhums.cli.morning import digest, watch
from mavhums.cli.options import (
    AIRCRAFT,
    AIRCRAFT_TABLE,
    AIRFRAME,
    DIALECT,
    FALSE_ALARMS,
    JSON,
    KEY,
    MODEL,
    NAMED_DATE,
    PATH,
    REPAIRS,
    gathered,
)
from mavhums.cli.output import say, say_json
from mavhums.core.about import EPILOG
from mavhums.core.errors import ExitCode

if TYPE_CHECKING:
    from mavhums.app.settings import Options
    from mavhums.fleet import Repair
    from mavhums.flights.queries import Odd, Status, Worst

__all__ = ["fleet"]

_STORE = click.argument("store", metavar="STORE")
_SHOWN = 20


@click.group(short_help="Judge many aircraft's logs into one store.")
def fleet() -> None:
    """Judge many aircraft's logs into one store, and ask it."""


@fleet.command(short_help="Judge logs that the store does not have yet.", epilog=EPILOG)
@click.argument("sources", nargs=-1, required=True, metavar="LOGS...")
@click.option(
    "--to",
    "store",
    required=True,
    metavar="STORE",
    help="The store: a folder, or s3://BUCKET/NAME and the like.",
)
@AIRCRAFT
@AIRCRAFT_TABLE
@click.option(
    "--workers",
    type=click.IntRange(0, 256),
    default=1,
    show_default=True,
    help="Processes on this machine; 0 judges in this one, which is soonest for the log of one landing.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers judge instead, tcp://….")
@AIRFRAME
@MODEL
@DIALECT
@FALSE_ALARMS
@REPAIRS
@KEY
@JSON
@gathered
def scan(
    options: Options,
    sources: tuple[str, ...],
    store: str,
    workers: int,
    scheduler: str | None,
    dates: tuple[tuple[str | None, datetime], ...],
    as_json: bool,
) -> None:
    """Judge the LOGS that STORE does not have yet: files, folders with logs, or patterns.

    Each aircraft's flights are compared with its first ones, whatever the order of arrival. A log that cannot
    be judged does not stop the scan. After an interruption the same command resumes.

    \b
    Exit codes, the first that applies:
      2 usage    1 a log that cannot be judged    0 all judged
    """
    from mavhums.fleet import ScanOptions
    from mavhums.fleet import scan as scan_logs
    from mavhums.flights.queries import odd_in

    scanning = ScanOptions(
        judging=options,
        aircraft=options.aircraft,
        aircraft_table=options.aircraft_table,
        workers=workers,
        scheduler=scheduler,
        repairs=[_repair(name, at) for name, at in dates],
    )
    done = scan_logs(sources, store, scanning, progress=_Progress())
    if as_json:
        foreign = [one.model_dump() for one in odd_in(store).foreign_boards]
        say_json(_line(done._asdict() | {"foreign_boards": foreign}))
    else:
        say(f"{done.judged} logs judged, {done.failed} could not be, {done.known} were known")
        for line in _odd(odd_in(store), store):
            say(line)
    raise SystemExit(ExitCode.ERROR if done.failed else ExitCode.OK)


@fleet.command(short_help="Show what the store holds, what grows, and what is wrong.")
@_STORE
@JSON
def status(store: str, as_json: bool) -> None:
    """Say what STORE holds, what grows, which logs are odd, and which could not be judged."""
    from mavhums.fleet import status as status_of
    from mavhums.show.standing import growth_words

    found = status_of(store)
    if as_json:
        say_json(found.published().model_dump_json())
        return
    named = ": scan them again with --aircraft RULE to name it" if found.unknown else ""
    say(f"{found.judged} logs of {found.aircraft} aircraft, and {found.unknown} of an unknown one{named}")
    grows = [(f"{name} {one.actuator}", one.growth) for name, one in found.growing if one.growth]
    _say_some([f"{what}: {growth_words(growth)}" for what, growth in grows], "actuators that grow")
    for line in _odd(found, store):
        say(line)
    _say_some([f"{problem}: {remedy}" for problem, remedy in found.failures], "logs that could not be judged")
    left_out = [f"{log}: is of the same flight as {counted}, which counts" for log, counted in found.copies]
    _say_some(left_out, "logs that do not count")


def _say_some(lines: Sequence[str], what: str) -> None:
    for line in lines[:_SHOWN]:
        say(line)
    if len(lines) > _SHOWN:
        say(f"{_SHOWN} of {len(lines)} {what} are shown; --json has all")


def _odd(found: Odd | Status, store: str) -> Iterator[str]:
    """Yield what an operator should correct, and what was corrected."""
    for one in found.foreign_boards:
        whose, log = one.elsewhere or "AIRCRAFT", one.logs[0] if len(one.logs) == 1 else "LOG..."
        remedy = f"mavhums fleet reassign {store} {log} {whose}"
        yield f"{one}: another aircraft's log? {remedy}; a swapped board? list both in --aircraft-table"
    if found.removed:
        logs = "removed log stays" if found.removed == 1 else "removed logs stay"
        yield f"{found.removed} {logs} out: mavhums fleet corrections {store}"


@fleet.command(short_help="Show the worst actuators of all aircraft.")
@_STORE
@click.option("-n", "most", type=click.IntRange(1), default=20, show_default=True, help="How many.")
@JSON
def worst(store: str, most: int, as_json: bool) -> None:
    """Show the actuators of all aircraft as they stand after their last flights, the worst first.

    A limit that was crossed stays crossed until a repair, or until five flights in a row say otherwise.

    \b
    Exit codes, the first that applies, of all aircraft:
      2 usage    11 an emergency    10 degraded, or certain growth    1 a log that could not be judged
      12 undecided    0 all normal
    """
    from mavhums.fleet import worst as worst_of
    from mavhums.flights.queries import actuators_in, exit_code

    rows = worst_of(store, most=most)
    if as_json:
        say_json(f"[{', '.join(row.published().to_json() for row in rows)}]")
    else:
        for row in rows:
            say(_words(row))
        if len(rows) == most and (total := actuators_in(store)) > most:
            say(f"the {most} worst of {total:,} are shown; -n shows more")
    raise SystemExit(exit_code(store))


@fleet.command(short_help="Show the trend of an aircraft's actuators.")
@_STORE
@click.argument("aircraft")
@JSON
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="OUT",
    help="Also write a row per flight and indicator to a table that ends in .csv or .parquet.",
)
def trend(store: str, aircraft: str, as_json: bool, output: Path | None) -> None:
    """Show the trend of each actuator of AIRCRAFT over its flights; exit codes as of `mavhums trend`."""
    from mavhums.cli.trend import write_trends
    from mavhums.core.output import writer_for
    from mavhums.fleet import trend as trend_of

    if output is not None:
        writer_for(output)
    report = trend_of(store, aircraft)
    if output is not None:
        write_trends(output, report.trends)
    if as_json:
        say_json(report.to_json())
    else:
        from rich.console import Console

        from mavhums.show.trend import render_trends

        render_trends(report, Console())
    raise SystemExit(report.exit_code)


@fleet.command(short_help="List, add or remove repairs.")
@_STORE
@click.option(
    "--add",
    type=NAMED_DATE,
    multiple=True,
    metavar="[[AIRCRAFT/]ACTUATOR=]DATE",
    help="Flights before that date no longer count: D-EABC/rudder=2026-03-01, or D-EABC/=2026-03-01"
    " for all its actuators. Can be repeated.",
)
@click.option(
    "--remove",
    type=NAMED_DATE,
    multiple=True,
    metavar="[[AIRCRAFT/]ACTUATOR=]DATE",
    help="Remove one that was entered by mistake, as it is listed. Can be repeated.",
)
@JSON
def repairs(
    store: str,
    add: tuple[tuple[str | None, datetime], ...],
    remove: tuple[tuple[str | None, datetime], ...],
    as_json: bool,
) -> None:
    """List the repairs that STORE keeps; add one, or remove one.

    The verdicts on the flights of their aircraft are made again at once; no log is opened for it.
    """
    from mavhums import fleet as stores

    if add or remove:
        there = stores.change_repairs(
            store,
            add=[_repair(name, at) for name, at in add],
            remove=[_repair(name, at) for name, at in remove],
        )
    else:
        there = stores.repairs_in(store)
    if as_json:
        say_json(_line([one._asdict() | {"at": one.at.isoformat()} for one in there]))
        return
    for one in there:
        say(str(one))
    if not there:
        say("no repairs")


@fleet.command(short_help="Write a row per verdict to a table.")
@_STORE
@click.option("-o", "--output", type=PATH, required=True, metavar="OUT", help="Ends in .csv or .parquet.")
def export(store: str, output: Path) -> None:
    """Write a row per verdict to a table, with flights and days left in the row of an actuator's last flight.

    \b
    Columns: https://github.com/mavhums/mavhums/blob/main/docs/guide/fleet.md#tables
    """
    from mavhums.fleet import export as export_to

    say(f"{output}: {len(export_to(store, output))} verdicts")


def _repair(name: str | None, at: datetime) -> Repair:
    """Return the repair that ``AIRCRAFT/ACTUATOR``, ``AIRCRAFT/`` or ``ACTUATOR`` names; None names all."""
    from mavhums.fleet import Repair

    aircraft, _, actuator = (name or "").rpartition("/")
    return Repair(aircraft or None, actuator or None, at)


class _Progress:
    """Prints the progress of a scan of several logs on standard error, at most once a second."""

    def __init__(self) -> None:
        self._begun_s = self._printed_s = monotonic()

    def __call__(self, done: int, total: int) -> None:
        now_s = monotonic()
        if total == 1 or (now_s - self._printed_s < 1.0 and done < total):
            return
        self._printed_s = now_s
        rate = done / max(now_s - self._begun_s, 1e-3)
        say(f"{done} of {total} logs, {rate:.1f} a second, {(total - done) / rate:.0f} s left", err=True)


def _words(row: Worst) -> str:
    from mavhums.show.standing import sentences
    from mavhums.show.words import condition_word

    verdict, standing = row.verdict, row.standing
    name = f"{row.aircraft or f'unknown ({row.path})'} {verdict.actuator}"
    if standing is None or not standing.is_finding:
        suspects = f", suspected: {', '.join(s.fault for s in verdict.suspects)}" if verdict.suspects else ""
        friction = f", friction {verdict.friction_nm.estimate:.3f} N·m" if verdict.friction_nm else ""
        reason = f": {verdict.reason}" if verdict.reason else ""
        said = f"{condition_word(verdict.gravest)}{friction}{suspects}{reason}"
    else:
        said = "; ".join(sentences(standing))
        said = said.replace(standing.condition, condition_word(standing.condition), 1)
    return f"{name}: {said}{_last(row.start_us)}"


def _last(start_us: int | None) -> str:
    """Return the date of the last flight, and how long ago it was if that is long."""
    if start_us is None:
        return ""
    from mavhums.flights.reports import SILENT_DAYS

    at = datetime.fromtimestamp(start_us / 1e6, tz=UTC)
    days = (datetime.now(UTC) - at).days
    return f"; last flight {at:%Y-%m-%d}" + (f", {days} days ago" if days > SILENT_DAYS else "")


def _line(content: object) -> str:
    import json

    return json.dumps(content, ensure_ascii=False)


for _command in (digest, watch, *COMMANDS):
    fleet.add_command(_command)
