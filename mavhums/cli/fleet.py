"""The commands ``trend``, and ``fleet …``: logs are judged into a store, asked for, and corrected."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

import click

from mavhums.cli.options import FILLED_STORE, FLEET_STORE, JSON, PATH, Dates, judging, repair_date, utc
from mavhums.cli.output import complain, draw, output_error, say, say_json
from mavhums.core.about import EPILOG
from mavhums.core.errors import ExitCode, MavhumsError

if TYPE_CHECKING:
    from mavhums.app.settings import Options
    from mavhums.fleet import Repair
    from mavhums.fleet.notify import Recipient
    from mavhums.fleet.scan import ScannedFlight
    from mavhums.flights.corrections import Correction
    from mavhums.flights.reports import OperatorTasks
    from mavhums.results.standing import FleetDigest, LastFlightOf, StoreStatus


_UNITS: Final = {"h": "hours", "d": "days", "w": "weeks"}
_NOTIFY = click.option(
    "--notify",
    multiple=True,
    metavar="URL",
    envvar="MAVHUMS_NOTIFY",
    help="Also send it: mailtos://USER:PASSWORD@HOST?from=A&to=B and the other URLs of apprise, or any"
    " https:// address, to which its JSON is posted; @FILE holds a URL a line. Can be repeated.",
)
_NOTIFY_ALWAYS = click.option("--notify-always", is_flag=True, help="Send it also when nothing changed.")


@click.command(short_help="Judge logs that the store does not have yet.", epilog=EPILOG)
@click.argument("sources", nargs=-1, required=True, metavar="LOGS...")
@FILLED_STORE
@judging(without=["decide", "store", "keep"])
@click.option(
    "--workers",
    type=click.IntRange(0, 256),
    default=1,
    help="Processes on this machine; 0 judges in this one, which is soonest for the log of one landing.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers judge instead, tls://….")
@JSON
def scan(
    options: Options,
    sources: tuple[str, ...],
    store: str,
    workers: int,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Judge the LOGS that the store does not have yet: files, folders with logs, or patterns.

    Each aircraft's flights are compared with its first ones, whatever the order of arrival. A log that cannot
    be judged does not stop the scan. After an interruption the same command resumes.

    \b
    Exit codes, the first that applies:
      2 usage    1 a log that cannot be judged    0 all judged
    """
    from mavhums.fleet import ScanOptions
    from mavhums.fleet import scan as scan_logs
    from mavhums.flights.reports import odd_in

    scanning = ScanOptions(judging=options, workers=workers, scheduler=scheduler)
    done = scan_logs(sources, store, scanning, progress=_Progress())
    if as_json:
        foreign = [one.model_dump() for one in odd_in(store).foreign_boards]
        say_json(done._asdict() | {"foreign_boards": foreign})
    else:
        say(f"{done.judged} logs judged, {done.failed} could not be, {done.known} were known")
        for line in odd_lines(odd_in(store), store):
            say(line)
    raise SystemExit(ExitCode.ERROR if done.failed else ExitCode.OK)


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


def odd_lines(found: OperatorTasks | StoreStatus, store: str) -> Iterator[str]:
    """Yield what an operator should correct, and what was corrected."""
    for one in found.foreign_boards:
        whose, log = one.elsewhere or "AIRCRAFT", one.logs[0] if len(one.logs) == 1 else "LOG..."
        remedy = f"mavhums fleet move --store {store} {log} {whose}"
        yield f"{one}: another aircraft's log? {remedy}; a swapped board? list both in --aircraft-table"
    if found.removed:
        logs = "removed log stays" if found.removed == 1 else "removed logs stay"
        yield f"{found.removed} {logs} out: mavhums fleet journal --store {store}"


def _time(value: str) -> datetime:
    """Read a date with its zone, UTC if none is given, or how long ago."""
    if ago := re.fullmatch(r"(\d{1,4})([hdw])", value):
        return datetime.now(UTC) - timedelta(**{_UNITS[ago[2]]: int(ago[1])})
    try:
        return utc(value)
    except ValueError:
        remedy = "write 2026-03-01, 2026-03-01T06:00, 12h or 3d"
        raise click.BadParameter(f"{value!r} is not a time: {remedy}") from None


@click.command(short_help="Report what changed since yesterday.", epilog=EPILOG)
@FLEET_STORE
@click.option(
    "--since",
    type=_time,
    default="1d",
    metavar="TIME",
    help="A date, or how long ago: 2026-03-01, 2026-03-01T06:00, 12h, 3d.",
)
@click.option("--html", type=PATH, metavar="OUT", help="Also write it as a page to mail.")
@click.option("--quiet", is_flag=True, help="Print nothing when nothing changed, as for cron.")
@click.option("--fail-on-news", is_flag=True, help="Exit with 11, 10 or 1 for what is new, as below.")
@_NOTIFY
@_NOTIFY_ALWAYS
@JSON
def digest(
    store: str,
    since: datetime,
    html: Path | None,
    quiet: bool,
    fail_on_news: bool,
    notify: tuple[str, ...],
    notify_always: bool,
    as_json: bool,
) -> None:
    """Say what changed in the store: findings that are new or gone, growth, silent aircraft, failed logs.

    What is as before is only counted: `mavhums fleet worst` has it. Where there is nothing to say, one
    line says so, and nothing is sent. What changed goes by when logs came into the store, not by when they
    were flown.

    Secrets need not be in the command: `--notify @FILE`, or the environment variable MAVHUMS_NOTIFY with
    URLs separated by spaces. The URLs: https://appriseit.com

    \b
    Exit codes, the first that applies:
      2 usage    1 the store or a URL cannot be used    4 it was made and printed, but not sent everywhere
      0 the digest was made, whatever it says
    With --fail-on-news, instead of 0 the first that applies:
      11 a new emergency    10 a new finding, growth or step    1 a log that failed    0 none of these
    """
    from mavhums.core.output import written_whole
    from mavhums.fleet import digest as digest_of
    from mavhums.fleet.notify import recipients_of
    from mavhums.show.html import document
    from mavhums.show.over_flights import digest_blocks

    recipients = recipients_of(notify) if notify else []
    found = digest_of(store, since)
    if html is not None:
        with written_whole(html) as temporary:
            temporary.write_text(document(digest_blocks(found)), encoding="utf-8")
    if as_json:
        say_json(found.to_json())
    elif not (quiet and found.is_empty):
        draw(digest_blocks(found))
    if not _sent(found, recipients, always=notify_always):
        raise SystemExit(ExitCode.NOT_SENT)
    raise SystemExit(found.exit_code if fail_on_news else ExitCode.OK)


@click.command(short_help="Judge logs as they land.", epilog=EPILOG)
@click.argument("sources", nargs=-1, required=True, metavar="LOGS...")
@FILLED_STORE
@judging(without=["decide", "store", "keep"])
@click.option(
    "--workers",
    type=click.IntRange(0, 256),
    default=1,
    help="Processes that judge, started when logs have landed; 0 judges in this one, which is lighter, but"
    " ends with a log that crashes it.",
)
@click.option(
    "--settle",
    "settle_s",
    type=click.FloatRange(0),
    default=60.0,
    metavar="SECONDS",
    help="Judge a log once its size and time have not changed for this long.",
)
@click.option(
    "--every",
    "every_s",
    type=click.FloatRange(0.1),
    default=10.0,
    metavar="SECONDS",
    help="Interval between looks for new logs.",
)
@click.option(
    "--digest-at",
    type=click.DateTime(["%H:%M"]),
    metavar="HH:MM",
    help="Print the digest of the last 24 hours at this local time every day, and send it by --notify.",
)
@_NOTIFY
@_NOTIFY_ALWAYS
def watch(
    options: Options,
    sources: tuple[str, ...],
    store: str,
    workers: int,
    settle_s: float,
    every_s: float,
    digest_at: datetime | None,
    notify: tuple[str, ...],
    notify_always: bool,
) -> None:
    """Judge the LOGS that land in folders, patterns or s3:// addresses, and print a line of each.

    It begins with the logs that the store does not have yet. A log that is still being written waits until
    it no longer changes; one that cannot be judged is reported and stops nothing. While the disk is full
    or a server is away, it tries again. Ctrl-C and SIGTERM end it with exit code 0; what was judged is in the
    store, and the next start continues.

    A digest that falls due while the program is not running is not sent later; a timer of systemd or cron
    that calls `mavhums fleet digest` sends it.
    """
    from mavhums.fleet import ScanOptions
    from mavhums.fleet import digest as digest_of
    from mavhums.fleet.notify import recipients_of
    from mavhums.fleet.scan import LogWatcher
    from mavhums.show.over_flights import digest_blocks

    recipients = recipients_of(notify) if notify else []
    scanning = ScanOptions(judging=options, workers=workers)
    watching = LogWatcher(sources, store, scanning, settle_s=settle_s)
    morning = _DailyTimer(digest_at) if digest_at else None
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        complained = ""
        while output_error() is None:
            try:
                for one in watching.look(time.monotonic()):
                    say(_line_of(one))
                complained = ""
                if morning and (since := morning.due(datetime.now().astimezone())):
                    found = digest_of(store, since)
                    draw(digest_blocks(found))
                    _sent(found, recipients, always=notify_always)
            except MavhumsError as error:
                if watching.looks == 0:
                    raise
                if complained != (complained := str(error)):
                    complain(error)
            time.sleep(every_s)
        raise SystemExit(ExitCode.ERROR)
    except KeyboardInterrupt:
        say("mavhums: stopped watching; the next start continues", err=True)
        raise SystemExit(ExitCode.OK) from None


class _DailyTimer:
    """Tells once a day that it is time for the digest."""

    def __init__(self, at: datetime) -> None:
        self._at = at.time()
        self._last: datetime | None = None

    def due(self, now: datetime) -> datetime | None:
        """Return since when the digest is, if it is time for it."""
        last, self._last = self._last, now
        today = now.replace(hour=self._at.hour, minute=self._at.minute, second=0, microsecond=0)
        return today - timedelta(days=1) if last is not None and last < today <= now else None


def _sent(found: FleetDigest, recipients: Sequence[Recipient], *, always: bool) -> bool:
    """Send a digest, an empty one only if ``always``; return whether it reached every recipient."""
    from mavhums.fleet.notify import send

    errors = send(found, recipients if always or not found.is_empty else ())
    for error in errors:
        complain(error)
    return not errors


def _line_of(one: ScannedFlight) -> str:
    """Return what is said of a log that has landed."""
    from mavhums.show.over_flights import sentence

    if one.problem is not None:
        return f"{one.problem}: {one.remedy}"
    said = [f"{each.actuator} {sentence(each)}" for each in one.findings]
    counted = ", ".join(f"{count} {condition}" for condition, count in one.conditions.items())
    return f"{one.path}: {one.aircraft or 'unknown aircraft'}: {'. '.join(said) or counted}"


_SHOWN = 20
_LOGS = click.argument("logs", nargs=-1, required=True, metavar="LOG...")
_NOTE = click.option("--note", metavar="TEXT", help="Why, for `mavhums fleet journal`.")
_WHO = click.option("--by", "who", metavar="NAME", help="Who corrects it. Default: the user.")


def _corrects(command: Callable[..., Any]) -> Callable[..., Any]:
    return _NOTE(_WHO(command))


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
        from mavhums.show.over_flights import trend_blocks

        draw(trend_blocks(report))
    raise SystemExit(report.exit_code)


@click.group(short_help="Judge many aircraft's logs into one store.")
def fleet() -> None:
    """Judge many aircraft's logs into one store, and ask it."""


@fleet.command(short_help="Show the store's contents, growing wear, and problems.")
@FLEET_STORE
@JSON
def status(store: str, as_json: bool) -> None:
    """Say what the store holds, what grows, which logs are odd, and which could not be judged."""
    from mavhums.fleet import status as status_of
    from mavhums.show.over_flights import growth_words

    found = status_of(store)
    if as_json:
        say_json(found.model_dump_json())
        return
    named = ": scan them again with --aircraft RULE to name it" if found.unknown else ""
    say(f"{found.judged} logs of {found.aircraft} aircraft, and {found.unknown} of an unknown one{named}")
    grows = [
        f"{one.aircraft} {one.standing.actuator}: {growth_words(one.standing.growth)}"
        for one in found.growing
        if one.standing.growth
    ]
    _print_first(grows, "actuators that grow")
    for line in odd_lines(found, store):
        say(line)
    failed = [f"{one.problem}: {one.remedy}" for one in found.failures]
    _print_first(failed, "logs that could not be judged")
    left_out = [f"{one.log}: is of the same flight as {one.counted}, which counts" for one in found.copies]
    _print_first(left_out, "logs that do not count")


def _print_all(lines: Sequence[object], none: str) -> None:
    """Say each in a line, or that there is none."""
    for line in lines or [none]:
        say(str(line))


def _print_first(lines: Sequence[str], what: str) -> None:
    for line in lines[:_SHOWN]:
        say(line)
    if len(lines) > _SHOWN:
        say(f"{_SHOWN} of {len(lines)} {what} are shown; --json has all")


@fleet.command(short_help="Show the worst actuators of all aircraft.")
@FLEET_STORE
@click.option("-n", "most", type=click.IntRange(1), default=20, help="How many.")
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
        say_json(f"[{', '.join(row.to_json() for row in rows)}]")
    else:
        for row in rows:
            say(_words(row))
        if len(rows) == most and (total := actuators_in(store)) > most:
            say(f"the {most} worst of {total:,} are shown; -n shows more")
    raise SystemExit(exit_code(store))


@fleet.command(short_help="List, add or remove repairs.")
@FLEET_STORE
@repair_date(
    "--add",
    text="Flights before that date no longer count, as after a repair: D-EABC/rudder=2026-03-01,"
    " D-EABC/=2026-03-01 for all its actuators, or rudder=2026-03-01 for all aircraft. Can be repeated.",
)
@repair_date("--remove", text="Remove one that was entered by mistake, as it is listed. Can be repeated.")
@JSON
def repairs(
    store: str,
    add: Dates,
    remove: Dates,
    as_json: bool,
) -> None:
    """List the repairs that the store keeps; add one, or remove one.

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
        say_json([one._asdict() | {"at": one.at.isoformat()} for one in there])
    else:
        _print_all(there, "no repairs")


def _repair(name: str | None, at: datetime) -> Repair:
    """Return the repair that ``AIRCRAFT/ACTUATOR``, ``AIRCRAFT/`` or ``ACTUATOR`` names; None names all."""
    from mavhums.fleet import Repair

    aircraft, _, actuator = (name or "").rpartition("/")
    return Repair(aircraft or None, actuator or None, at)


@fleet.command(short_help="Write a row per verdict to a table.")
@FLEET_STORE
@click.option("-o", "--output", type=PATH, required=True, metavar="OUT", help="Ends in .csv or .parquet.")
def export(store: str, output: Path) -> None:
    """Write a row per verdict to a table, with flights and days left in the row of an actuator's last flight.

    \b
    Columns: https://github.com/mavhums/mavhums/blob/main/docs/guide/fleet.md#tables
    """
    from mavhums.fleet import export as export_to

    say(f"{output}: {len(export_to(store, output))} verdicts")


def _words(row: LastFlightOf) -> str:
    from mavhums.show.over_flights import found_in, sentence
    from mavhums.show.words import condition_word

    verdict, standing = row.verdict, row.standing
    name = f"{row.aircraft or f'unknown ({row.log})'} {verdict.actuator}"
    if standing is not None and standing.is_finding:
        return f"{name}: {sentence(standing)}{_last(row.start_utc)}"
    found = ": ".join(filter(None, (condition_word(verdict.gravest), found_in(verdict, None))))
    return f"{name}: {found}{_last(row.start_utc)}"


def _last(start_utc: str | None) -> str:
    """Return the date of the last flight, and how long ago it was if that is long."""
    if start_utc is None:
        return ""
    from mavhums.flights.reports import SILENT_DAYS

    at = datetime.fromisoformat(start_utc)
    days = (datetime.now(UTC) - at).days
    return f"; last flight {at:%Y-%m-%d}" + (f", {days} days ago" if days > SILENT_DAYS else "")


def _done(change: Correction | None, none: str) -> None:
    say(str(change) if change else none)


@fleet.command(short_help="Remove logs that do not belong in the store.")
@FLEET_STORE
@_LOGS
@_corrects
def remove(store: str, logs: tuple[str, ...], who: str | None, note: str | None) -> None:
    """Remove LOGs from the store, as if they had never been scanned; the files stay where they are.

    A LOG is its path or address, a folder with all its logs, the end of a path (D-EABC/0007.tlog), or at
    least eight digits of its hash. Later scans leave it alone, also under another name; `mavhums fleet
    journal --undo` takes it back.
    """
    from mavhums.fleet import remove as remove_logs

    _done(remove_logs(store, logs, who=who, note=note), "nothing to do: it was removed before")


@fleet.command(short_help="Move logs to another aircraft.")
@FLEET_STORE
@_LOGS
@click.argument("aircraft")
@_corrects
def move(store: str, logs: tuple[str, ...], aircraft: str, who: str | None, note: str | None) -> None:
    """Move LOGs in the store to AIRCRAFT: both aircraft are compared as if scanned so from the start.

    A LOG is named as for `remove`. Later scans leave it there, whatever its folder or board says. To move a
    log to the aircraft that it has already confirms it.
    """
    from mavhums.fleet import move as move_logs

    change = move_logs(store, logs, aircraft, who=who, note=note)
    _done(change, f"nothing to do: it is one of {aircraft}")


@fleet.command(short_help="Rename an aircraft.")
@FLEET_STORE
@click.argument("aircraft")
@click.argument("name")
@click.option("--join", is_flag=True, help="If there is one named NAME, make one aircraft of both.")
@_corrects
def rename(store: str, aircraft: str, name: str, join: bool, who: str | None, note: str | None) -> None:
    """Rename AIRCRAFT to NAME, with its repairs and history.

    Later scans call it NAME, too, where a folder, a board or the table says AIRCRAFT: so an aircraft that
    only its board names ("board 4D41…") gets a name.
    """
    from mavhums.fleet import rename as rename_aircraft

    change = rename_aircraft(store, aircraft, name, join=join, who=who, note=note)
    _done(change, f"nothing to do: it is named {name}")


@fleet.command(short_help="List the corrections and their authors, or undo one.")
@FLEET_STORE
@click.option("--undo", type=click.IntRange(1), metavar="NUMBER", help="Undo the one with this number.")
@JSON
def journal(store: str, undo: int | None, as_json: bool) -> None:
    """List the corrections of the store, the first one first: number, when, by whom, what, and why."""
    from mavhums import fleet as stores

    found = stores.journal(store) if undo is None else [stores.undo(store, undo)]
    if as_json:
        logs = ([log._asdict() for log in one.logs] for one in found)
        rows = zip(found, logs, strict=True)
        say_json([one._asdict() | {"at": one.at.isoformat(), "logs": each} for one, each in rows])
    else:
        _print_all(found, "no corrections")


for _command in (scan, digest, watch):
    fleet.add_command(_command)
