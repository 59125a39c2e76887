"""``mavhums fleet scan``, ``watch`` and ``digest``: judge logs into a store, and report what is new."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from mavhums.cli.options import FILLED_STORE, FLEET_STORE, JSON, PATH, judging, utc
from mavhums.cli.output import complain, draw, output_error, say, say_json, steps
from mavhums.core.about import EPILOG
from mavhums.core.errors import ExitCode, MavhumsError

if TYPE_CHECKING:
    from mavhums.app.settings import Options
    from mavhums.fleet.notify import Recipient
    from mavhums.fleet.watch import ScannedFlight
    from mavhums.results.standing import FleetDigest, StoreStatus


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
    from mavhums.fleet import ScanOptions, status
    from mavhums.fleet import scan as scan_logs

    scanning = ScanOptions(judging=options, workers=workers, scheduler=scheduler)
    with steps("logs") as progress:
        done = scan_logs(sources, store, scanning, progress=progress)
    if as_json:
        foreign = [one.model_dump() for one in status(store).foreign_boards]
        say_json(done._asdict() | {"foreign_boards": foreign})
    else:
        say(f"{done.judged} logs judged, {done.failed} could not be, {done.known} were known")
        for line in odd_lines(status(store), store):
            say(line)
    raise SystemExit(ExitCode.ERROR if done.failed else ExitCode.OK)


def odd_lines(found: StoreStatus, store: str) -> Iterator[str]:
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
    from mavhums.show.standing import digest_blocks

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
def watch(
    options: Options,
    sources: tuple[str, ...],
    store: str,
    workers: int,
    settle_s: float,
    every_s: float,
) -> None:
    """Judge the LOGS that land in folders, patterns or s3:// addresses, and print a line of each.

    It begins with the logs that the store does not have yet. A log that is still being written waits until
    it no longer changes; one that cannot be judged is reported and stops nothing. While the disk is full
    or a server is away, it tries again. Ctrl-C and SIGTERM end it with exit code 0; what was judged is in the
    store, and the next start continues.

    What changed is reported by `mavhums fleet digest`, which a timer of systemd or cron calls once a day.
    """
    from mavhums.fleet import ScanOptions
    from mavhums.fleet.watch import LogWatcher

    scanning = ScanOptions(judging=options, workers=workers)
    watching = LogWatcher(sources, store, scanning, settle_s=settle_s)
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGINT))
    try:
        complained = ""
        while output_error() is None:
            try:
                for one in watching.look(time.monotonic()):
                    say(_line_of(one))
                complained = ""
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


def _sent(found: FleetDigest, recipients: Sequence[Recipient], *, always: bool) -> bool:
    """Send a digest, an empty one only if ``always``; return whether it reached every recipient."""
    from mavhums.fleet.notify import send

    errors = send(found, recipients if always or not found.is_empty else ())
    for error in errors:
        complain(error)
    return not errors


def _line_of(one: ScannedFlight) -> str:
    """Return what is said of a log that has landed."""
    from mavhums.show.standing import sentence

    if one.problem is not None:
        return f"{one.problem}: {one.remedy}"
    said = [f"{each.actuator} {sentence(each)}" for each in one.findings]
    counted = ", ".join(f"{count} {condition}" for condition, count in one.conditions.items())
    return f"{one.path}: {one.aircraft or 'unknown aircraft'}: {'. '.join(said) or counted}"
