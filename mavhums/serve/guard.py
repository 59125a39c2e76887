"""Protects the page: origin, host, token and size of a request, and the time that a header may take.

Starlette's check of hosts takes no IPv6 address and no range; neither Starlette nor uvicorn limits a body, or
ends a connection that does not complete a header.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
import socket
from collections.abc import Iterable
from typing import Any, ClassVar, Final
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from itsdangerous import BadSignature, Signer
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

SESSION: Final = "mavhums.session"
"""Key of the session's id in the scope of a request."""

UPLOADS: Final = "/logs"
API: Final = "/api"
"""Where programs ask: they have the token in a header, no cookies, and take errors as JSON."""

_LARGE: Final = (UPLOADS, f"{API}/logs")
"""The only paths that take a large body; their own code limits it."""


_BODY: Final = 1 << 20
_POLICY: Final = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "frame-ancestors 'self'; form-action 'self'; base-uri 'none'; object-src 'none'"
)
_HEADERS: Final = {
    "content-security-policy": _POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "SAMEORIGIN",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Return whether only this computer reaches a host.

    Examples
    --------
    >>> is_loopback("127.0.0.1"), is_loopback("::1"), is_loopback("localhost"), is_loopback("0.0.0.0")
    (True, True, True, False)
    """
    address = _address(host)
    return host == "localhost" if address is None else address.is_loopback


class Guard:
    """An ASGI application in front of another.

    Every request must name a host that this server has: on the loopback address only a loopback name, else
    also an address or this computer's own name, and always its public name. A foreign name is what DNS
    rebinding shows. An ``Origin``
    must be the page's own. With a token, a request must carry it: once in the query, then in a cookie. Bodies
    are limited to 1 MiB except those of uploads.

    Parameters
    ----------
    app
        The application behind.
    host
        Address at which the server listens.
    token
        Secret that a request must carry; None for no token.
    cookie
        Begin of the cookies' names, different for each server of a host.
    public
        Name, with its port if it has one, under which a proxy with TLS serves the page; None without one.
    """

    def __init__(
        self,
        app: ASGIApp,
        host: str,
        token: str | None,
        cookie: str = "mavhums",
        *,
        public: str | None = None,
    ) -> None:
        self.app = app
        self._public = _name_of(public or "")
        self._local = is_loopback(host)
        self._names = {"localhost"} if self._local else {"localhost", host.lower(), *_own_names()}
        self._token = token
        self._cookie = cookie
        self._signer = Signer(secrets.token_bytes(32))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":  # the server starts and ends; it has no websockets
            await self.app(scope, receive, send)
            return
        request, headers = HTTPConnection(scope), Headers(scope=scope)
        if self._public and _name_of(headers.get("host", "")) == self._public:
            scope["scheme"] = "https"  # as the browser sees it
        refusal = self._refusal(scope, headers)
        if refusal:
            answer = _refused(scope, *refusal)
        elif self._token is not None and not self._known(request):
            answer = self._asked(request)
        elif "content-length" in headers and scope["path"] not in _LARGE and _length(headers) > _BODY:
            answer = _refused(scope, 413, "too large; only a log may be larger than 1 MiB")
        else:
            await self._pass_on(request, receive, send)
            return
        await answer(scope, receive, _with_headers(send))

    async def _pass_on(self, request: HTTPConnection, receive: Receive, send: Send) -> None:
        """Let the application answer in the session that the request names, or in a new one."""
        scope, cookie, given = request.scope, request.cookies.get(f"{self._cookie}-session", ""), []
        try:  # only a session that this server has named
            scope[SESSION] = self._signer.unsign(cookie).decode()
        except BadSignature:
            scope[SESSION] = secrets.token_urlsafe(24)
            cookie = self._signer.sign(scope[SESSION]).decode()
            given = [] if _is_api(scope) else [self._cookie_text(scope, "session", cookie)]
        bounded = receive if scope["path"] in _LARGE else _Bounded(receive)
        await self.app(scope, bounded, _with_headers(send, given))

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        host = headers.get("host", "")
        name = _name_of(host)
        address = _address(name)
        allowed = (
            name in self._names
            or (self._public and name == self._public)
            or (address is not None and (address.is_loopback if self._local else True))
        )
        if not allowed:
            return 421, "this page is not served under that name; open the address that mavhums printed"
        origin, from_another = headers.get("origin"), "a request from another page is refused"
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return 403, from_another
        if headers.get("sec-fetch-site") in ("cross-site", "same-site") and not _navigates(scope, headers):
            return 403, from_another
        return None

    def _known(self, request: HTTPConnection) -> bool:
        scheme, _, bearer = request.headers.get("authorization", "").partition(" ")
        cookie = request.cookies.get(f"{self._cookie}-token", "")
        return self._is_token(bearer if scheme.lower() == "bearer" else cookie)

    def _is_token(self, given: str) -> bool:
        return self._token is not None and secrets.compare_digest(given.encode(), self._token.encode())

    def _asked(self, request: HTTPConnection) -> Response:
        """Take the token from the query of a page, and lead to the page without it."""
        scope = request.scope
        query = parse_qsl(scope.get("query_string", b"").decode("latin-1"))
        given = dict(query).get("token", "")
        if _is_api(scope):
            text = "a token is needed; send the one that mavhums serve printed: Authorization: Bearer TOKEN"
            return _refused(scope, 401, text)
        if scope["method"] != "GET" or not self._is_token(given):
            return _refused(scope, 401, "a token is needed; open the address that mavhums serve printed")
        rest = urlencode([pair for pair in query if pair[0] != "token"])
        place = "/" + quote(scope["path"].lstrip("/\\")) + (f"?{rest}" if rest else "")
        cookie = self._cookie_text(scope, "token", given)
        return RedirectResponse(place, 303, headers={"set-cookie": cookie})

    def _cookie_text(self, scope: Scope, what: str, value: str) -> str:
        secure = "; Secure" if scope.get("scheme") == "https" else ""
        return f"{self._cookie}-{what}={value}; Path=/; HttpOnly; SameSite=Lax{secure}"


class _Bounded:
    """Ends a request whose body is too large."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self._left = _BODY

    async def __call__(self) -> Message:
        message = await self._receive()
        self._left -= len(message.get("body", b""))
        return message if self._left >= 0 else {"type": "http.disconnect"}


def _with_headers(send: Send, cookies: Iterable[str] = ()) -> Send:
    """Add the headers that every answer has; one that the answer has itself stays."""

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            for cookie in cookies:
                headers.append("set-cookie", cookie)
        await send(message)

    return sent


def _refused(scope: Scope, status: int, text: str) -> Response:
    """Return the answer that says why a request is refused."""
    ends = {"connection": "close"}
    if _is_api(scope):
        problem, _, remedy = text.partition("; ")
        return JSONResponse({"problem": problem, "remedy": remedy}, status, ends)
    return PlainTextResponse(f"{text}\n", status, ends)


def _is_api(scope: Scope) -> bool:
    return bool(scope["path"] == API or scope["path"].startswith(f"{API}/"))


def _navigates(scope: Scope, headers: Headers) -> bool:
    """Return whether a user follows a link to this page."""
    to_page = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    return to_page and scope.get("method") == "GET"


def _length(headers: Headers) -> int:
    text = headers["content-length"]
    return int(text) if text.isascii() and text.isdigit() and len(text) < 16 else _BODY + 1


def _name_of(host: str) -> str:
    """Return the host without its port and brackets."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _own_names() -> set[str]:
    name = socket.gethostname().lower()
    return {name, f"{name}.local", socket.getfqdn().lower()} - {""}


HEADER_S: Final = 30.0
"""Time in which a connection must have sent a whole header, s."""

MOST: Final = 200
"""Connections at a time; the rest of a process's 1,024 files is for logs and judging processes."""

MOST_OF_ADDRESS: Final = 64
"""Connections of one address: ten open pages of a browser take about 20."""

_HEADER: Final = 1 << 16
_BUSY: Final = (
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: text/plain\r\nconnection: close\r\n\r\n"
    b"too many connections; try again in a moment\n"
)


class _LimitedConnection(HttpToolsProtocol):
    """A connection of uvicorn's with a limited header: its size is 64 kB, and its time 30 s.

    Where places are short, the connection that has waited longest for its header loses its own. Whoever has
    sent a header is refused at once or has the token, and the time of an upload is limited where it is read.
    """

    header_s: ClassVar[float] = HEADER_S
    most: ClassVar[int] = MOST
    most_of_address: ClassVar[int] = MOST_OF_ADDRESS

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._wait_for_header()
        others = self.connections - {self}
        own = [each for each in others if _client_of(each) == _client_of(self)]
        if len(own) >= self.most_of_address:
            self._make_room(own)
        elif len(others) >= self.most:
            self._make_room(others)

    def connection_lost(self, exc: Exception | None) -> None:
        self._ends.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        cycle = self.cycle
        if self._ends.cancelled() and (cycle is None or cycle.response_complete):
            self._wait_for_header()
        super().data_received(data)
        if self.cycle is not cycle:
            self._ends.cancel()
        elif not self._ends.cancelled():
            self._left -= len(data)
            if self._left < 0:
                self.transport.abort()

    def _wait_for_header(self) -> None:
        self._left, self._ends = _HEADER, self.loop.call_later(self.header_s, self.transport.abort)

    def _make_room(self, others: Iterable[Any]) -> None:
        waiting = [each for each in others if not each._ends.cancelled()]
        if waiting:
            longest = min(waiting, key=lambda each: each._ends.when())
            longest.transport.abort()
            self.connections.discard(longest)  # it is lost only after this turn of the loop
            return
        self.transport.write(_BUSY)
        self.transport.close()


def limited_connections(
    *, header_s: float = HEADER_S, most: int = MOST, most_of_address: int = MOST_OF_ADDRESS
) -> type[asyncio.Protocol]:
    """Return the class of the connections for uvicorn's option ``http``.

    Parameters
    ----------
    header_s
        Time for a header, s.
    most, most_of_address
        Connections at a time, of all addresses and of one.
    """
    limits = {"header_s": header_s, "most": most, "most_of_address": most_of_address}
    return type("LimitedConnection", (_LimitedConnection,), limits)


def _client_of(connection: Any) -> str:
    return str(connection.client[0]) if connection.client else ""
