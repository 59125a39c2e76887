"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

Dates = tuple[tuple[str | None, datetime], ...]
"""Dates from which flights count, each with the name before it: of an actuator, or None for all."""

# What cannot be read is an error of one log among several, and not of the usage.
PATH: click.Path = click.Path(path_type=Path, readable=False)
STORE = click.argument("store", metavar="STORE")
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
    show_default=True,
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
    help="CSV or TOML of the boards and actuators installed in each aircraft, with dates; before --aircraft."
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
    show_default=True,
    metavar="N",
    help="Allowed false alarms per 100 hours of an actuator: fewer alarms come later, more come earlier.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


class _PlaceParameter(click.ParamType["Path | str"]):
    """A path, or the address of an object store, which stays a text."""

    name = "path"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Path | str:
        return str(value) if "://" in str(value) else Path(str(value))


HISTORY = click.option(
    "--history",
    type=_PlaceParameter(),
    metavar="DIR|STORE",
    help="The aircraft's earlier flights, for each actuator's own baseline: a folder of its assessments, or"
    " the store of a fleet.",
)
JOBS = click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    metavar="N",
    help="Judge so many logs at once. Default: as many as there are cores, but one where the logs are small.",
)
KEEP = click.option("--keep", is_flag=True, help="Put the flight into the folder or the store of --history.")


def utc(text: str) -> datetime:
    """Return a date or a time with its zone, UTC if none is given."""
    at = datetime.fromisoformat(text)
    return at if at.tzinfo else at.replace(tzinfo=UTC)


class _NamedDate(click.ParamType[tuple[str | None, datetime]]):
    """A date such as ``2026-03-01`` for every actuator, or ``rudder=2026-03-01`` for one."""

    name = "date"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str | None, datetime]:
        name, _, date = str(value).rpartition("=")
        try:
            return name or None, utc(date)
        except ValueError:
            self.fail(f"{value!r} is not a date: write 2026-03-01, or rudder=2026-03-01", param, ctx)


BASELINE_FROM = click.option(
    "--baseline-from",
    "dates",
    type=_NamedDate(),
    multiple=True,
    metavar="[ACTUATOR=]DATE",
    help="Flights before that date no longer count, as after a repair: of all actuators, or of one."
    " Can be repeated.",
)


def repair_date(*names: str, text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return an option with dates of repairs in a store."""
    metavar = "[[AIRCRAFT/]ACTUATOR=]DATE"
    return click.option(*names, type=_NamedDate(), multiple=True, metavar=metavar, help=text)


REPAIRS = repair_date(
    "--baseline-from",
    "dates",
    text="Flights before that date no longer count, as after a repair: D-EABC/rudder=2026-03-01, or"
    " D-EABC/=2026-03-01 for all its actuators. The store keeps it. Can be repeated.",
)

_JUDGING: Final = {
    "airframe": AIRFRAME,
    "model": MODEL,
    "decide": _DECIDE,
    "dialect": DIALECT,
    "false_alarms": _FALSE_ALARMS,
    "aircraft": _AIRCRAFT,
    "aircraft_table": AIRCRAFT_TABLE,
    "key": _KEY,
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

            names = [name for name in _JUDGING if name in given]
            return command(options=Options(**{name: given.pop(name) for name in names}), **given)

        for name, option in reversed(_JUDGING.items()):
            if name not in without:
                with_options = option(with_options)
        return with_options

    return decorate
