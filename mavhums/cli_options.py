"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path

import click

__all__ = ["AIRFRAME", "DIALECT", "JSON", "KEY", "LOG", "LOGS", "PATH"]

PATH: click.Path = click.Path(path_type=Path)
LOG = click.argument("log", metavar="LOG", type=PATH)
LOGS = click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=PATH)
AIRFRAME = click.option(
    "--airframe",
    metavar="NAME|FILE",
    help="Airframe profile: a TOML file or a packaged name. Default: the one that the log names itself.",
)
DIALECT = click.option(
    "--dialect", type=PATH, metavar="FILE", help="MAVLink XML whose messages go before the ones known here."
)
KEY = click.option(
    "--key",
    type=PATH,
    metavar="FILE",
    help="Accept only frames signed (MAVLink 2) with the key in FILE: 32 bytes, or 64 hexadecimal digits.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
