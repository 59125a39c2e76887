"""The command ``mcp``: a server of the Model Context Protocol on standard input and output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.options import STORE, judging
from mavhums.core.about import EPILOG, NOTICE, __version__
from mavhums.core.errors import MavhumsError, MissingExtraError

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

    from mavhums.app.assistant import LogAssistant
    from mavhums.app.settings import Options


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
@judging()
@STORE
@click.option("--max-logs", type=click.IntRange(1, 1000), default=20, help="Logs of one request.")
@click.option("--max-mb", type=click.IntRange(1, 100_000), default=1000, help="Size of a log, unpacked.")
def mcp(options: Options, folders: tuple[Path, ...], store: str | None, max_logs: int, max_mb: int) -> None:
    """Serve the tools inspect, analyse, trend and explain to an assistant that speaks MCP.

    The assistant starts this command and talks to it over standard input and output; mavhums opens no
    network connection, writes nothing, and reads logs in the folders only. What the assistant does with the
    answers, which hold paths and ids of boards but no positions, is up to it.
    """
    from mavhums.app.assistant import LogAssistant, Reach

    reach = Reach(folders=folders, logs=max_logs, log_bytes=max_mb * 1_000_000)
    server_of(LogAssistant(reach, replace(options, store=store))).run()
