"""Clients that stall keep no one out, and lose their places; nobody else does."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
import urllib.request
from collections.abc import Iterator, MutableMapping
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="the page needs the extra 'serve'")

import uvicorn

from mavhums.serve import guard as guards
from mavhums.serve.guard import Guard, held_connections
from tests.serve.browser import served

HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-"


async def application(scope: MutableMapping[str, Any], receive: Any, send: Any) -> None:
    """Answer after as many seconds as the path says."""
    if scope["type"] == "lifespan":
        return
    await asyncio.sleep(float(scope["path"][1:] or 0))
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"ok"})


@contextlib.contextmanager
def serving(**limits: Any) -> Iterator[int]:
    """The port of a server with these limits."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(500)
        config = uvicorn.Config(
            application, log_level="error", lifespan="off", http=held_connections(**limits)
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        try:
            yield listening.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join(timeout=30)


def stalled(port: int, number: int) -> list[socket.socket]:
    several = [socket.create_connection(("127.0.0.1", port), timeout=30) for _ in range(number)]
    for one in several:
        one.sendall(HALF)
    return several


def answer(port: int, path: str = "/") -> int:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=30) as response:
        return int(response.status)


def is_closed(one: socket.socket) -> bool:
    try:
        return one.recv(100) == b""
    except ConnectionResetError:
        return True


@pytest.mark.parametrize("limits", [{"most_of_address": 8}, {"most": 8}])
def test_half_headers_keep_no_one_out(limits: dict[str, int]) -> None:
    with serving(**limits) as port, contextlib.ExitStack() as exits:
        for one in stalled(port, 30):
            exits.enter_context(one)
        assert [answer(port) for _ in range(20)] == [200] * 20


def test_a_stalled_client_loses_its_place() -> None:
    with serving(header_s=0.3) as port:
        for one in stalled(port, 3):
            with one:
                assert is_closed(one)


def test_a_client_that_sends_a_header_byte_by_byte_loses_its_place() -> None:
    with serving(header_s=0.3) as port, socket.create_connection(("127.0.0.1", port), timeout=30) as one:
        one.settimeout(0.05)
        one.sendall(HALF)
        end = time.monotonic() + 30
        closed = False
        while not closed and time.monotonic() < end:
            try:
                one.sendall(b"x")
                closed = one.recv(10) == b""
            except TimeoutError:
                continue
            except ConnectionError:
                closed = True
        assert closed


def test_an_answer_that_takes_longer_than_a_header_arrives() -> None:
    with serving(header_s=0.2, most_of_address=1) as port:
        assert answer(port, "/1") == 200


@pytest.mark.slow
def test_where_all_are_at_work_the_new_one_is_told() -> None:
    with serving(most_of_address=1) as port, socket.create_connection(("127.0.0.1", port)) as busy:
        busy.sendall(b"GET /3 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        time.sleep(0.5)
        with socket.create_connection(("127.0.0.1", port), timeout=30) as new:
            assert b"503" in new.recv(100)
        assert b"200 OK" in busy.recv(100)


def test_a_body_that_does_not_come_ends_the_request(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guards, "_BODY_S", 0.1)
    got: list[str] = []

    async def behind(scope: Any, receive: Any, send: Any) -> None:
        got.extend([(await receive())["type"], (await receive())["type"]])

    messages = [{"type": "http.request", "body": b"x", "more_body": True}]

    async def receive() -> Any:
        return messages.pop() if messages else await asyncio.sleep(60)

    async def send(_: Any) -> None:
        pass

    scope = {"type": "http", "path": "/", "method": "POST", "headers": [(b"host", b"127.0.0.1")]}
    asyncio.run(Guard(behind, "127.0.0.1", None)(scope, receive, send))
    assert got == ["http.request", "http.disconnect"]


@pytest.mark.slow
def test_the_page_is_there_for_all_while_clients_stall() -> None:
    pytest.importorskip("nicegui", reason="the page needs the extra 'serve'")
    with served() as page, contextlib.ExitStack() as exits:
        port = int(page.url.rpartition(":")[2])
        assert answer(port) == 200
        for _ in range(3):
            for one in stalled(port, 210):
                exits.enter_context(one)
            assert answer(port) == 200
