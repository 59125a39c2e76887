"""Runs the page: the guard, the routes, the pages and the judging processes, until it is stopped."""

from __future__ import annotations

import asyncio
import os
import secrets
import shutil
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.serve.guard import API, Guard, is_loopback
from mavhums.serve.sessions import ServeOptions, Sessions
from mavhums.serve.workers import Workers

if TYPE_CHECKING:
    from fastapi import FastAPI

_WAITING: Final = 200


def serve(options: ServeOptions, report: Callable[[str], object]) -> None:
    """Serve the page until a signal ends it.

    Parameters
    ----------
    options
        Address, limits, store and live files.
    report
        Called with each line for the user: the address, who can reach it, and the token.

    Raises
    ------
    MissingExtraError
        If the packages of the extra ``serve`` are not installed.
    MavhumsError
        If the address cannot be listened at.
    """
    try:
        import fastapi  # noqa: F401
        import uvicorn

        if find_spec("plotly") is None:
            raise ImportError("plotly")
    except ImportError as error:
        raise MissingExtraError("the page", "serve") from error
    from mavhums.serve.guard import MOST, MOST_OF_ADDRESS, limited_connections

    listening = _listening(options.host, options.port)
    port: int = listening.getsockname()[1]
    alone = is_loopback(options.host) and options.public is None
    token = None if alone else secrets.token_urlsafe(18)
    workers = Workers(options.limits)
    sessions = Sessions(options.limits, options.judging, workers)
    try:
        application = _application(options, sessions, workers)
        guard = Guard(application, options.host, token, f"mavhums-{port}", public=options.public)
        for line in _greeting(options, port, token):
            report(line)
        config = uvicorn.Config(
            guard,
            log_level="error",
            lifespan="on",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            # a proxy has one address for all, and limits its clients itself
            http=limited_connections(most_of_address=MOST if options.public else MOST_OF_ADDRESS),
            ws="none",
            timeout_graceful_shutdown=1,
        )
        uvicorn.Server(config).run(sockets=[listening])
    finally:  # also when a signal comes before the page is ready
        shutil.rmtree(sessions.folder, ignore_errors=True)


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address.

    Raises
    ------
    MavhumsError
        If it cannot.
    """
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        both = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        # Who asks before the page is ready waits.
        return socket.create_server(address, family=family, backlog=_WAITING, dualstack_ipv6=both)
    except OSError as error:
        why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
        remedy = "stop the program there, or choose another --port (0 takes a free one) or --host"
        raise MavhumsError(f"{host}:{port}: {why or error}", remedy) from error


def _greeting(options: ServeOptions, port: int, token: str | None) -> list[str]:
    host = options.host
    name = f"[{host}]" if ":" in host else host
    if token is None:
        return [
            f"mavhums: http://{name}:{port}/",
            "Only programs on this computer can open it. Logs stay here and are removed when it ends.",
        ]
    if options.public is not None:
        return [
            f"mavhums: https://{options.public}/?token={token}",
            f"WARNING: who reaches {options.public} and has this token, which is shown only now, can open it."
            f" The proxy hands requests on to http://{name}:{port}/.",
        ]
    if host in ("0.0.0.0", "::"):
        name = socket.gethostname()
    return [
        f"mavhums: http://{name}:{port}/?token={token}",
        f"WARNING: every computer that reaches {host} can open it with this token, which is shown only now.",
        "The link is not encrypted: use it in a network that you trust, or behind a proxy with TLS.",
    ]


def _application(options: ServeOptions, sessions: Sessions, workers: Workers) -> FastAPI:
    from fastapi import FastAPI

    from mavhums.serve.pages import add_pages
    from mavhums.serve.routes import add_routes, api

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        workers.start()
        janitor = asyncio.create_task(sessions.forget_old())
        try:
            yield
        finally:
            janitor.cancel()
            with suppress(asyncio.CancelledError):
                await janitor
            await workers.close()
            sessions.close()

    app = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    add_pages(app, sessions, options, add_routes(app, sessions, options.store))
    app.mount(API, api(sessions, options.store))
    return app
