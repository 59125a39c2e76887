"""The guard: who may ask, under which name, from which page, and how much."""

from __future__ import annotations

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

from mavhums.serve.guard import SESSION, Guard

LOCAL = "127.0.0.1:8080"


class Behind:
    """An application that reads the body and notes what reached it."""

    def __init__(self) -> None:
        self.sessions: list[str] = []
        self.body = b""
        self.gone = False

    async def __call__(self, scope: MutableMapping[str, Any], receive: Any, send: Any) -> None:
        self.sessions.append(scope[SESSION])
        more = True
        while more and not self.gone:
            message = await receive()
            self.gone = message["type"] == "http.disconnect"
            self.body += message.get("body", b"")
            more = message.get("more_body", False)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})


def ask(
    guard: Guard,
    headers: dict[str, str],
    *,
    path: str = "/",
    query: str = "",
    method: str = "GET",
    parts: int = 1,
) -> tuple[Any, dict[str, str]]:
    """Return the status and the headers."""
    sent: list[MutableMapping[str, Any]] = []
    left = parts

    async def receive() -> MutableMapping[str, Any]:
        nonlocal left
        left -= 1
        return {"type": "http.request", "body": b"x" * (1 << 18), "more_body": left > 0}

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message)

    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "path": path, "query_string": query.encode(), "method": method, "headers": pairs}
    asyncio.run(guard(scope, receive, send))
    first = sent[0]
    found = {name.decode(): value.decode() for name, value in first.get("headers", ())}
    return first["status"], found


OWN = {  # what each address of the page is called
    "127.0.0.1": ("127.0.0.1:8080", "localhost:8080", "[::1]:8080", "LOCALHOST", "127.0.0.2"),
    "hangar.example": ("hangar.example:8080", "10.1.2.3:8080", "[fe80::1]:8080"),
}


@pytest.mark.parametrize(("bound", "host"), [(bound, host) for bound, names in OWN.items() for host in names])
def test_each_name_of_the_page_is_served(bound: str, host: str) -> None:
    guard = Guard(Behind(), bound, None if bound == "127.0.0.1" else "right")
    assert ask(guard, {"host": host, "cookie": "mavhums-token=right"})[0] == 200


@pytest.mark.parametrize(
    "host", ["evil.example:8080", "", "192.168.0.5:8080", "localhost.evil.example", "[::", "0.0.0.0"]
)
def test_a_foreign_name_is_refused_as_dns_rebinding_shows_one(host: str) -> None:
    behind = Behind()
    assert ask(Guard(behind, "127.0.0.1", None), {"host": host})[0] == 421
    assert ask(Guard(behind, "127.0.0.1", None), {})[0] == 421
    other = {"host": "evil.example", "cookie": "mavhums-token=right"}
    assert ask(Guard(behind, "hangar.example", "right"), other)[0] == 421
    assert not behind.sessions


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "http://localhost:8080"]
)
def test_another_page_is_refused(origin: str) -> None:
    guard = Guard(Behind(), "127.0.0.1", None)
    assert ask(guard, {"host": LOCAL, "origin": origin}, method="POST")[0] == 403
    own = {"host": LOCAL, "origin": f"http://{LOCAL}"}
    assert ask(guard, own, method="POST")[0] == 200


def test_a_foreign_page_may_link_here_but_not_embed_or_fetch() -> None:
    guard = Guard(Behind(), "127.0.0.1", None)
    foreign = {"host": LOCAL, "sec-fetch-site": "cross-site"}
    assert ask(guard, foreign | {"sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"})[0] == 403
    assert ask(guard, foreign | {"sec-fetch-mode": "navigate", "sec-fetch-dest": "iframe"})[0] == 403
    link = foreign | {"sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    assert ask(guard, link)[0] == 200
    assert ask(guard, link, method="POST")[0] == 403


def test_without_the_token_nothing_is_served() -> None:
    behind = Behind()
    guard = Guard(behind, "0.0.0.0", "right")
    host = {"host": "192.168.0.5:8080"}
    for headers, query in (
        ({}, ""),
        ({}, "token=wrong"),
        ({}, "token=rightx"),
        ({"authorization": "Bearer wrong"}, ""),
        ({"cookie": "mavhums-token=wrong"}, ""),
        ({"cookie": "mavhums-token="}, ""),
        ({"cookie": "; = \x00"}, ""),
        ({"authorization": "Bearer ünïcode"}, ""),
    ):
        assert ask(guard, host | headers, query=query)[0] == 401
    own = host | {"origin": "http://192.168.0.5:8080"}
    assert ask(guard, own, method="POST", path="/logs", query="token=right")[0] == 401
    assert not behind.sessions


def test_the_token_opens_the_page_and_leaves_its_address() -> None:
    guard = Guard(Behind(), "0.0.0.0", "right")
    host = {"host": "192.168.0.5:8080"}
    for path in ("//evil.example/x", "/\\evil.example/x"):
        status, headers = ask(guard, host, path=path, query="token=right&name=a%20b")
        assert (status, headers["location"]) == (303, "/evil.example/x?name=a+b")
    assert headers["set-cookie"] == "mavhums-token=right; Path=/; HttpOnly; SameSite=Lax"
    assert ask(guard, host | {"cookie": "mavhums-token=right"})[0] == 200
    assert ask(guard, host | {"authorization": "Bearer right"})[0] == 200


def test_a_large_body_is_refused_except_for_uploads() -> None:
    behind = Behind()
    guard = Guard(behind, "127.0.0.1", None)
    for length in ("1048577", "-1", "x", "9" * 30):
        assert ask(guard, {"host": LOCAL, "content-length": length}, method="POST", path="/x")[0] == 413
    assert not behind.sessions
    ask(guard, {"host": LOCAL}, method="POST", path="/x", parts=9)
    assert behind.gone
    assert len(behind.body) <= 1 << 20
    upload = Behind()
    ask(Guard(upload, "127.0.0.1", None), {"host": LOCAL}, method="POST", path="/logs", parts=9)
    assert len(upload.body) == 9 << 18


def test_each_browser_gets_a_session_of_its_own_once() -> None:
    behind = Behind()
    guard = Guard(behind, "127.0.0.1", None, "mavhums-1")
    _, first = ask(guard, {"host": LOCAL})
    _, second = ask(guard, {"host": LOCAL})
    assert first["set-cookie"] != second["set-cookie"]
    assert "HttpOnly" in first["set-cookie"]
    _, again = ask(guard, {"host": LOCAL, "cookie": first["set-cookie"].split(";")[0]})
    assert "set-cookie" not in again
    assert behind.sessions[2] == behind.sessions[0] != behind.sessions[1]
    for chosen in ("chosen", "x" * 32, f"{behind.sessions[0]}", f"{behind.sessions[0]}.{'x' * 27}"):
        _, other = ask(guard, {"host": LOCAL, "cookie": f"mavhums-1-session={chosen}"})
        assert "set-cookie" in other
        assert behind.sessions[-1] not in (chosen, behind.sessions[0]), "the server chooses it"


def test_a_page_can_load_nothing_from_elsewhere() -> None:
    _, headers = ask(Guard(Behind(), "127.0.0.1", None), {"host": LOCAL})
    policy = headers["content-security-policy"]
    assert policy.startswith("default-src 'self';")
    assert "http" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
