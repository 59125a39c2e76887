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

from mavhums.serve.guard import limited_connections
from tests.serve.browser import served

HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-"


async def application(scope: MutableMapping[str, Any], receive: Any, send: Any) -> None:
    """Answer after as many seconds as the path says, after a whole body, or with 50 MB."""
    if scope["type"] == "lifespan":
        return
    if scope["path"] == "/body":
        while (await receive()).get("more_body"):
            pass
        return
    if scope["path"] == "/big":
        await send({"type": "http.response.start", "status": 200, "headers": []})
        for more in [True] * 800 + [False]:
            await send({"type": "http.response.body", "body": b"x" * (1 << 16), "more_body": more})
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
            application, log_level="error", lifespan="off", http=limited_connections(**limits)
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        try:
            yield listening.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join(timeout=30)


def stalled(port: int, number: int, begins: bytes = HALF) -> list[socket.socket]:
    several = [socket.create_connection(("127.0.0.1", port), timeout=30) for _ in range(number)]
    for one in several:
        one.sendall(begins)
    return several


def answer(port: int, path: str = "/") -> int:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=30) as response:
        return int(response.status)


def is_closed(one: socket.socket) -> bool:
    try:
        return one.recv(100) == b""
    except ConnectionResetError:
        return True


def is_open(one: socket.socket) -> bool:
    one.setblocking(False)
    try:
        return one.recv(1) != b""
    except BlockingIOError:
        return True


@pytest.mark.parametrize("limits", [{"most_of_address": 8}, {"most": 8}])
def test_half_headers_keep_no_one_out(limits: dict[str, int]) -> None:
    with serving(**limits) as port, contextlib.ExitStack() as exits:
        for one in stalled(port, 30):
            exits.enter_context(one)
        assert [answer(port) for _ in range(20)] == [200] * 20


@pytest.mark.parametrize("more", [b"", b"x"], ids=["stalls", "sends byte by byte"])
def test_a_client_without_a_whole_header_loses_its_place(more: bytes) -> None:
    with serving(header_s=0.3) as port, socket.create_connection(("127.0.0.1", port), timeout=30) as one:
        one.settimeout(0.05)
        one.sendall(HALF)
        end = time.monotonic() + 30
        closed = False
        while not closed and time.monotonic() < end:
            try:
                one.sendall(more)
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
def test_where_all_are_at_work_the_new_one_gets_an_answer() -> None:
    with serving(most_of_address=1) as port, socket.create_connection(("127.0.0.1", port)) as busy:
        busy.sendall(b"GET /3 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        time.sleep(0.5)
        with socket.create_connection(("127.0.0.1", port), timeout=30) as new:
            assert b"503" in new.recv(100)
        assert b"200 OK" in busy.recv(100)


UPLOAD = b"POST /body HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000000\r\n\r\n"


def test_a_slow_upload_keeps_its_place_and_the_longest_wait_for_a_header_ends() -> None:
    with serving(most_of_address=3) as port, contextlib.ExitStack() as exits:
        (upload,) = (exits.enter_context(one) for one in stalled(port, 1, UPLOAD))
        time.sleep(0.2)
        first, last = (exits.enter_context(one) for one in stalled(port, 2))
        time.sleep(0.2)
        assert answer(port) == 200
        assert is_closed(first)
        assert is_open(upload)
        assert is_open(last)


def test_each_request_of_a_connection_has_its_own_time() -> None:
    request = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with serving(header_s=0.5) as port, socket.create_connection(("127.0.0.1", port), timeout=30) as one:
        for _ in range(4):
            one.sendall(request)
            found = b""
            while not found.endswith(b"ok"):
                found += one.recv(1000)
            time.sleep(0.3)
        one.sendall(HALF)
        assert is_closed(one)


def test_an_endless_header_ends() -> None:
    with serving() as port, socket.create_connection(("127.0.0.1", port), timeout=30) as one:
        with contextlib.suppress(ConnectionError):
            one.sendall(HALF + b"x" * 10_000_000)
        assert is_closed(one)


@pytest.mark.slow
def test_the_page_is_there_for_all_while_clients_stall() -> None:
    pytest.importorskip("plotly", reason="the page needs the extra 'serve'")
    with served() as page, contextlib.ExitStack() as exits:
        port = int(page.url.rpartition(":")[2])
        assert answer(port) == 200
        for _ in range(3):
            for one in stalled(port, 210):
                exits.enter_context(one)
            assert answer(port) == 200
