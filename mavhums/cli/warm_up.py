"""The command ``warm-up``, and the notice that the first call compiles."""

from __future__ import annotations

import sys
import time

import click

from mavhums.cli.output import say
from mavhums.core import compiling

__all__ = ["announce_compiling", "warm_up"]


@click.command("warm-up", short_help="Compile the inner loops now, not at the first log.")
def warm_up() -> None:
    """Compile the inner loops now, so that the first log of any format need not wait for it.

    That happens once after an installation or an update, and takes some twenty seconds. The result is kept
    beside the installation, or in the user's cache where that cannot be written; where neither can, set
    NUMBA_CACHE_DIR to a folder that can.
    """
    from mavhums.app.warm_up import warm_up as compile_all

    begin = time.monotonic()
    compiled = compile_all()
    took = f"{time.monotonic() - begin:.0f} s"
    say(f"ready: {compiled} loops compiled in {took}" if compiled else "ready: nothing was left to compile")


def announce_compiling() -> None:
    """Print on standard error why the first call takes longer; on a terminal with a count."""
    count = 0

    def tell() -> None:
        nonlocal count
        count += 1
        if count == 1:
            text = "mavhums: compiling its inner loops for this machine, once; it takes some twenty seconds"
            say(f"{text} (ahead of time: mavhums warm-up)", err=True)
        if sys.stderr.isatty():
            click.echo(f"\r  {count} loops", nl=False, err=True)

    compiling.on_compile(tell)
