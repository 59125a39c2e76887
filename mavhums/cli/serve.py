"""The commands that serve: ``serve``, the page in the browser, and ``mcp``, tools for an assistant."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.options import PATH, judging
from mavhums.cli.output import say
from mavhums.core.about import EPILOG, NOTICE, __version__
from mavhums.core.errors import MavhumsError, MissingExtraError

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

    from mavhums.app.assistant import LogAssistant
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
@judging(without=["decide", "aircraft", "aircraft_table", "key", "keep"])
def serve(
    options: Options,
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
    from mavhums.serve.server import serve as serve_page
    from mavhums.serve.sessions import ServeOptions
    from mavhums.serve.uploads import Quotas

    if isinstance(options.model, str):
        load_model(options.model)  # a wrong name is refused now, not with the first log that somebody drops
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
        judging=options,
        limits=limits,
        live=lines,
    )
    store = page.store
    if store is not None and not Store(store).exists and not Path(store).absolute().parent.is_dir():
        raise MavhumsError(f"{store}: no such folder", "make it, or name another store")
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


def server_of(assistant: LogAssistant) -> MCPServer:
    """Return the server whose tools are what an assistant may ask.

    Raises
    ------
    MissingExtraError
        If the SDK is not installed.
    """
    try:
        from mcp.server.mcpserver import MCPServer
        from mcp.server.mcpserver.exceptions import ToolError
        from mcp.types import ToolAnnotations
    except ImportError as error:
        raise MissingExtraError("the MCP server", "mcp") from error

    def tool(function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def answer(*args: Any, **given: Any) -> Any:
            try:
                return function(*args, **given)
            except MavhumsError as error:
                raise ToolError(f"{error.problem}. Remedy: {error.remedy or 'none'}") from error

        return answer

    server = MCPServer(
        "mavhums",
        version=__version__,
        instructions=f"Health of a UAV's servos, control axes and motors from its logs; {NOTICE}. "
        "Name a log by its path within the opened folders. A verdict that is undecided or unmonitored says "
        "nothing about health.",
        log_level="ERROR",
    )
    reads = ToolAnnotations(read_only_hint=True, open_world_hint=False)
    for function in (assistant.inspect, assistant.analyse, assistant.trend, assistant.explain):
        server.add_tool(tool(function), annotations=reads)
    return server


@click.command(short_help="Answer an assistant's questions about logs (MCP).", epilog=EPILOG)
@click.option(
    "--folder",
    "folders",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    multiple=True,
    default=(Path(),),
    show_default="the current one",
    metavar="DIR",
    help="Logs in this folder may be read; can be repeated.",
)
@judging(without=["keep"])
@click.option("--max-logs", type=click.IntRange(1, 1000), default=20, help="Logs of one request.")
@click.option("--max-mb", type=click.IntRange(1, 100_000), default=1000, help="Size of a log, unpacked.")
def mcp(options: Options, folders: tuple[Path, ...], max_logs: int, max_mb: int) -> None:
    """Serve the tools inspect, analyse, trend and explain to an assistant that speaks MCP.

    The assistant starts this command and talks to it over standard input and output; mavhums opens no
    network connection, writes nothing, and reads logs in the folders only. What the assistant does with the
    answers, which hold paths and ids of boards but no positions, is up to it.
    """
    from mavhums.app.assistant import LogAssistant, Reach

    reach = Reach(folders=folders, logs=max_logs, log_bytes=max_mb * 1_000_000)
    server_of(LogAssistant(reach, options)).run()
