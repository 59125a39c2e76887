"""The commands ``mavhums fleet …``: many aircraft's logs in one store."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import click

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
    from mavhums.flights.queries import Worst

__all__ = ["fleet"]

_STORE = click.argument("store", metavar="STORE")
_SHOWN_FAILURES = 20
_UNITS = {"h": "hours", "d": "days", "w": "weeks"}


class _TimeParam(click.ParamType[datetime]):
    """A time: a date, or how long ago."""

    name = "time"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> datetime:
        """Return the time with its zone, UTC if none is given."""
        if isinstance(value, datetime):
            return value
        ago = re.fullmatch(r"(\d{1,4})([hdw])", value)
        if ago:
            return datetime.now(UTC) - timedelta(**{_UNITS[ago[2]]: int(ago[1])})
        try:
            at = datetime.fromisoformat(value)
        except ValueError:
            self.fail(f"{value!r} is no time: write 2026-03-01, 2026-03-01T06:00, 12h or 3d", param, ctx)
        return at if at.tzinfo else at.replace(tzinfo=UTC)


_SINCE = _TimeParam()


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
        say_json(_line(done._asdict()))
    else:
        say(f"{done.judged} logs judged, {done.failed} could not be, {done.known} were known")
    raise SystemExit(ExitCode.ERROR if done.failed else ExitCode.OK)


@fleet.command(short_help="Show what the store holds, and what failed.")
@_STORE
@JSON
def status(store: str, as_json: bool) -> None:
    """Say what STORE holds, and which logs could not be judged."""
    from mavhums.fleet import status as status_of

    found = status_of(store)
    if as_json:
        say_json(found.published().model_dump_json())
        return
    named = ": scan them again with --aircraft RULE to name it" if found.unknown else ""
    say(f"{found.judged} logs of {found.aircraft} aircraft, and {found.unknown} of an unknown one{named}")
    for problem, remedy in found.failures[:_SHOWN_FAILURES]:
        say(f"{problem}: {remedy}")
    if len(found.failures) > _SHOWN_FAILURES:
        say(f"and {len(found.failures) - _SHOWN_FAILURES} more that could not be judged")
    for log, counted in found.copies[:_SHOWN_FAILURES]:
        say(f"{log}: is of the same flight as {counted}, which counts")
    if len(found.copies) > _SHOWN_FAILURES:
        say(f"and {len(found.copies) - _SHOWN_FAILURES} more that do not count")


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
    from mavhums.flights.queries import exit_code

    rows = worst_of(store, most=most)
    if as_json:
        say_json(f"[{', '.join(row.published().to_json() for row in rows)}]")
    else:
        for row in rows:
            say(_words(row))
        if len(rows) == most:
            say(f"the {most} worst are shown; -n shows more")
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
    from mavhums.core.table_writers import writer_for
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


@fleet.command(short_help="Say what changed since yesterday.", epilog=EPILOG)
@_STORE
@click.option(
    "--since",
    type=_SINCE,
    default="1d",
    show_default=True,
    metavar="TIME",
    help="A date, or how long ago: 2026-03-01, 2026-03-01T06:00, 12h, 3d.",
)
@click.option("--html", type=PATH, metavar="OUT", help="Also write it as a page to mail.")
@click.option("--quiet", is_flag=True, help="Print nothing where there is nothing to say, as for cron.")
@click.option("--fail-on-news", is_flag=True, help="Exit with 11, 10 or 1 for what is new, as below.")
@JSON
def digest(
    store: str, since: datetime, html: Path | None, quiet: bool, fail_on_news: bool, as_json: bool
) -> None:
    """Say what changed in STORE: findings that are new or gone, growth, silent aircraft, failed logs.

    What stands as before is counted only: `mavhums fleet worst` has it. Where there is nothing to say, one
    line says so. What changed goes by when logs came into the store, not by when they were flown.

    \b
    Exit codes:
      2 usage    1 the store cannot be read    0 the digest was made, whatever it says
    With --fail-on-news, the first that applies:
      11 a new emergency    10 a new finding, growth or step    1 a log that failed    0 none of these
    """
    from mavhums.core.files import written_whole
    from mavhums.fleet import digest as digest_of
    from mavhums.show.changes import digest_html, digest_lines

    found = digest_of(store, since)
    if html is not None:
        with written_whole(html) as temporary:
            temporary.write_text(digest_html(found), encoding="utf-8")
    if as_json:
        say_json(found.to_json())
    elif not (quiet and found.is_empty):
        for line in digest_lines(found):
            say(line)
    raise SystemExit(found.exit_code if fail_on_news else ExitCode.OK)


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


@fleet.command()
@_STORE
@click.option("-o", "--output", type=PATH, required=True, metavar="OUT", help="Ends in .csv or .parquet.")
def export(store: str, output: Path) -> None:
    """Write a row per verdict to a table."""
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
    from mavhums.flights.changes import SILENT_DAYS

    at = datetime.fromtimestamp(start_us / 1e6, tz=UTC)
    days = (datetime.now(UTC) - at).days
    return f"; last flight {at:%Y-%m-%d}" + (f", {days} days ago" if days > SILENT_DAYS else "")


def _line(content: object) -> str:
    import json

    return json.dumps(content, ensure_ascii=False)
