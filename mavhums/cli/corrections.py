"""The commands that correct a fleet's store, and the one that lists who corrected what."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.options import JSON
from mavhums.cli.output import say, say_json

if TYPE_CHECKING:
    from mavhums.flights.corrections import Correction

__all__ = ["COMMANDS"]

_STORE = click.argument("store", metavar="STORE")
_LOGS = click.argument("logs", nargs=-1, required=True, metavar="LOG...")
_NOTE = click.option("--note", metavar="TEXT", help="Why, for `mavhums fleet corrections`.")
_WHO = click.option("--by", "who", metavar="NAME", help="Who corrects it. Default: the user.")


def _corrects(command: Callable[..., Any]) -> Callable[..., Any]:
    return _NOTE(_WHO(command))


@click.command(short_help="Remove logs that do not belong in the store.")
@_STORE
@_LOGS
@_corrects
def remove(store: str, logs: tuple[str, ...], who: str | None, note: str | None) -> None:
    """Remove LOGs from STORE, as if they had never been scanned; the files stay where they are.

    A LOG is its path or address, a folder with all its logs, the end of a path (D-EABC/0007.tlog), or at
    least eight digits of its hash. Later scans leave it alone, also under another name; `mavhums fleet
    restore` takes it back.
    """
    from mavhums.fleet import remove as remove_logs

    _tell(remove_logs(store, logs, who=who, note=note), "was removed before")


@click.command(short_help="Put removed logs back.")
@_STORE
@_LOGS
@_corrects
def restore(store: str, logs: tuple[str, ...], who: str | None, note: str | None) -> None:
    """Put LOGs back that were removed from STORE; no log is read for it. A LOG is named as for `remove`."""
    from mavhums.fleet import restore as restore_logs

    _tell(restore_logs(store, logs, who=who, note=note), "is there")


@click.command(short_help="Give logs to another aircraft.")
@_STORE
@_LOGS
@click.argument("aircraft")
@_corrects
def reassign(store: str, logs: tuple[str, ...], aircraft: str, who: str | None, note: str | None) -> None:
    """Give LOGs in STORE to AIRCRAFT: those of both aircraft are compared as if scanned so from the start.

    A LOG is named as for `remove`. Later scans leave it there, whatever its folder or board says. To give a
    log to the aircraft that it has already confirms it.
    """
    from mavhums.fleet import reassign as reassign_logs

    _tell(reassign_logs(store, logs, aircraft, who=who, note=note), f"is one of {aircraft}")


@click.command(short_help="Rename an aircraft.")
@_STORE
@click.argument("aircraft")
@click.argument("name")
@click.option("--join", is_flag=True, help="If there is one named NAME, make one aircraft of both.")
@_corrects
def rename(store: str, aircraft: str, name: str, join: bool, who: str | None, note: str | None) -> None:
    """Rename AIRCRAFT in STORE to NAME, with its repairs and history.

    Later scans call it NAME, too, where a folder, a board or the table says AIRCRAFT: so an aircraft that
    only its board names ("board 4D41…") gets a name.
    """
    from mavhums.fleet import rename as rename_aircraft

    changes = rename_aircraft(store, aircraft, name, join=join, who=who, note=note)
    _tell(changes, f"is named {name}")


@click.command(short_help="List who corrected what.")
@_STORE
@JSON
def corrections(store: str, as_json: bool) -> None:
    """List the corrections of STORE, the first one first: when, by whom, what, and why."""
    import json

    from mavhums.fleet import corrections_in

    found = corrections_in(store)
    if as_json:
        told = [one._asdict() | {"at": one.at.isoformat()} for one in found]
        say_json(json.dumps(told, ensure_ascii=False))
        return
    for one in found:
        say(str(one))
    if not found:
        say("no corrections")


def _tell(changes: Sequence[Correction], otherwise: str) -> None:
    for one in changes:
        say(str(one))
    if not changes:
        say(f"nothing to do: it {otherwise}")


COMMANDS = (remove, restore, reassign, rename, corrections)
