"""The command ``serve``: the page in the browser."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mavhums.cli.options import PATH, STORE, judging
from mavhums.cli.output import say
from mavhums.core.about import EPILOG
from mavhums.core.errors import MavhumsError

if TYPE_CHECKING:
    from mavhums.app.settings import Options

LEAST_MEMORY_MB = 512
"""Judging and recording a log of 4 MB beside a store takes 330 to 470 MB; with 256 MB nothing starts."""


@click.command(short_help="Open a page in the browser: drop logs, see verdicts.", epilog=EPILOG)
@click.option("--port", type=click.IntRange(0, 65535), default=8080, help="0 takes a free port.")
@click.option(
    "--host",
    default="127.0.0.1",
    help="Address to listen at. Any but a loopback address lets other computers in, and needs a token.",
)
@click.option(
    "--public-name",
    "public",
    metavar="NAME[:PORT]",
    callback=lambda _, __, name: _public(name),
    help="Name under which a proxy with TLS serves the page, as docs/guide/page.md shows; it needs a token.",
)
@click.option(
    "--live",
    "lines",
    multiple=True,
    type=PATH,
    metavar="FILE",
    help="Show the session whose `mavhums live --json` writes to FILE. Can be repeated.",
)
@click.option("--max-mb", type=click.IntRange(1, 100_000), default=1000, help="Size of a log.")
@click.option("--max-seconds", type=click.IntRange(1, 86_400), default=300, help="Time to judge one.")
@click.option(
    "--max-memory-mb",
    type=click.IntRange(LEAST_MEMORY_MB, 1_000_000),
    default=2048,
    help="Memory to judge one (Linux only).",
)
@click.option("--workers", type=click.IntRange(1, 64), default=2, help="Processes that judge.")
@judging(without=["decide", "aircraft", "aircraft_table", "key"])
@STORE
def serve(
    options: Options,
    store: str | None,
    port: int,
    host: str,
    public: str | None,
    lines: tuple[Path, ...],
    max_mb: int,
    max_seconds: int,
    max_memory_mb: int,
    workers: int,
) -> None:
    """Serve a page in the browser: drop logs, see the verdicts; with a store, the fleet.

    The page works without a network, and logs never leave this computer. Nothing is kept: logs are removed
    when the session ends, unless you keep one in the store. A log is compared with the flights of its
    aircraft there.
    """
    from mavhums.flights.store import Store
    from mavhums.learn import load_model
    from mavhums.serve.options import Quotas, ServeOptions
    from mavhums.serve.server import serve as serve_page

    if isinstance(options.model, str):
        load_model(options.model)  # a wrong name is refused now, not with the first log that somebody drops
    if store is not None and not Store(store).exists and not Path(store).absolute().parent.is_dir():
        raise MavhumsError(f"{store}: no such folder", "make it, or name another store")
    limits = Quotas(
        log_bytes=max_mb * 1_000_000,
        judge_s=float(max_seconds),
        memory_bytes=max_memory_mb << 20,
        workers=workers,
    )
    page = ServeOptions(
        host=host,
        port=port,
        public=public,
        judging=replace(options, store=store),
        limits=limits,
        live=lines,
    )
    serve_page(page, say)


def _public(name: str | None) -> str | None:
    """Hold a public name to be one: without scheme and path."""
    if name is not None and not re.fullmatch(
        r"[a-z0-9]([a-z0-9.-]*[a-z0-9])?(:[0-9]{1,5})?", name, re.IGNORECASE
    ):
        raise click.BadParameter(
            f"{name!r} is not the name of a host: write hums.example.org, without https://"
        )
    return name.lower() if name else None
