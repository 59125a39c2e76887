"""Arguments and options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from mavhums.core.errors import MavhumsError

Dates = tuple[tuple[str | None, datetime], ...]
"""Dates of repairs, each with the name before it: AIRCRAFT/ACTUATOR, either of these, or None for all."""

_NONE: Final = "none"

# What cannot be read is an error of one log among several, and not of the usage.
PATH: click.Path = click.Path(path_type=Path, readable=False)
LOG = click.argument("log", metavar="LOG", type=PATH)
LOGS = click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=PATH)
AIRFRAME = click.option(
    "--airframe",
    metavar="NAME|FILE",
    help="Airframe profile: a TOML file or a packaged name. Default: the one that the log names itself.",
)
MODEL = click.option(
    "--model",
    metavar="NAME|FILE",
    help="Network: a model file or a packaged name, such as paper-esc. Default: the packaged one for each"
    " telemetry.",
)
_DECIDE = click.option(
    "--decide",
    type=click.Choice(["physics", "network", "both"]),
    default="physics",
    help="Who decides an actuator's friction. physics: the physics, or a network if the profile has no"
    " limits. network: a network wherever one is for the airframe. both: the physics, and the network's"
    " disagreement is reported.",
)
_AIRCRAFT = click.option(
    "--aircraft",
    metavar="RULE",
    help="Names the log's aircraft: 'folder' for the name of its folder, '=NAME' for this name, 'board' for"
    " the id of its board, or a regular expression of the path with a group (?P<aircraft>…). Default: the"
    " rule that the store remembers, else the board's id.",
)
AIRCRAFT_TABLE = click.option(
    "--aircraft-table",
    type=PATH,
    metavar="FILE",
    help="CSV of the boards and actuators installed in each aircraft, with dates; before --aircraft."
    " The baseline of an actuator begins anew when it is swapped.",
)
DIALECT = click.option(
    "--dialect",
    type=PATH,
    metavar="FILE",
    help="MAVLink XML whose messages take precedence over the known ones.",
)
_KEY = click.option(
    "--key",
    type=PATH,
    metavar="FILE",
    help="Accept only frames signed (MAVLink 2) with the key in FILE: 32 bytes, or 64 hexadecimal digits.",
)
_FALSE_ALARMS = click.option(
    "--false-alarms",
    type=click.FloatRange(0.001, 1000.0),
    default=1.0,
    metavar="N",
    help="Allowed false alarms per 100 hours of an actuator: fewer alarms come later, more come earlier.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


def own_store() -> str:
    """Return the place of the user's own store: the file of this user, or what the environment names."""
    from platformdirs import user_data_path

    return os.environ.get("MAVHUMS_STORE") or str(user_data_path("mavhums", False) / "flights.sqlite")


def _store(*, makes: bool = False, needed: bool = False, text: str) -> Callable[..., Any]:
    """Return the option with the place of a store; without it, the user's own one is meant, once it exists.

    Parameters
    ----------
    makes
        Whether the command makes a store that does not exist; others do so with ``--keep``.
    needed
        Whether there is nothing to do without a store.
    text
        The first sentence of its help.
    """

    def place(ctx: click.Context, _: click.Parameter, given: str | None) -> str | None:
        keeps = makes or ctx.params.get("keep", False)
        found: str | None = given or own_store()
        if found == _NONE:
            found = None
        if found and not given and not keeps and "://" not in found and not Path(found).exists():
            found = None
        if found is None and needed:
            remedy = "keep a first one: mavhums analyse LOG --keep; or name a store with --store"
            raise MavhumsError("no flights are kept yet", remedy)
        if found is None and keeps:
            raise click.UsageError("--keep needs a store: leave out --store none")
        return found

    return click.option(
        "--store",
        metavar="FILE|URL",
        callback=place,
        help=f"{text} A file, or postgresql://USER@HOST/NAME. Default: your own, which --keep makes.",
    )


STORE = _store(text="Compare with the aircraft's earlier flights in this store; 'none' with no other.")
FLEET_STORE = _store(needed=True, text="The store.")
FILLED_STORE = _store(makes=True, needed=True, text="The store that is filled.")
JOBS = click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    metavar="N",
    help="Judge so many logs at once. Default: as many as there are cores, but one where the logs are small.",
)
KEEP = click.option("--keep", is_flag=True, is_eager=True, help="Put the flight into the store.")


def utc(text: str) -> datetime:
    """Return a date or a time with its zone, UTC if none is given."""
    at = datetime.fromisoformat(text)
    return at if at.tzinfo else at.replace(tzinfo=UTC)


def _named_date(value: str) -> tuple[str | None, datetime]:
    """Read a date such as ``2026-03-01`` for every actuator, or ``rudder=2026-03-01`` for one."""
    name, _, date = value.rpartition("=")
    try:
        return name or None, utc(date)
    except ValueError:
        remedy = "write 2026-03-01, or rudder=2026-03-01"
        raise click.BadParameter(f"{value!r} is not a date: {remedy}") from None


def repair_date(*names: str, text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return an option with dates of repairs in a store."""
    metavar = "[[AIRCRAFT/]ACTUATOR=]DATE"
    return click.option(*names, type=_named_date, multiple=True, metavar=metavar, help=text)


_JUDGING: Final = {
    "airframe": AIRFRAME,
    "model": MODEL,
    "decide": _DECIDE,
    "dialect": DIALECT,
    "false_alarms": _FALSE_ALARMS,
    "aircraft": _AIRCRAFT,
    "aircraft_table": AIRCRAFT_TABLE,
    "key": _KEY,
    "store": STORE,
    "keep": KEEP,
}


def judging(*, without: Sequence[str] = ()) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command the options of judging, gathered into its argument ``options``.

    Parameters
    ----------
    without
        Options that the command lacks, or has with a meaning of its own.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def with_options(**given: Any) -> Any:
            from mavhums.app.settings import Options

            names = [name for name in _JUDGING if name not in without]
            return command(options=Options(**{name: given.pop(name) for name in names}), **given)

        for name, option in reversed(_JUDGING.items()):
            if name not in without:
                with_options = option(with_options)
        return with_options

    return decorate
