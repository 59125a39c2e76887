"""The commands ``trend``, and ``fleet …``: what a store holds on many aircraft, and its corrections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.options import FLEET_STORE, JSON, PATH, Dates, repair_date
from mavhums.cli.output import draw, say, say_json
from mavhums.core.about import EPILOG

if TYPE_CHECKING:
    from mavhums.fleet import Repair
    from mavhums.flights.corrections import Correction
    from mavhums.results.standing import LastFlightOf
from mavhums.cli.fleet_scan import digest, odd_lines, scan, watch

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
        from mavhums.show.trend import trend_blocks

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
    from mavhums.show.standing import growth_words

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
    """Show the state of all actuators of all aircraft after their last flights, the worst first.

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
    from mavhums.show.standing import found_in, sentence
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
