"""Holds every connection to its duty, so that clients that stall do not keep others out.

A connection that has not sent a whole header in time is closed. Where there are too many, of one address
or in all, the oldest one that waits for its client makes room for the new one; the new one is refused only if
all are at work.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, ClassVar, Final

from uvicorn.protocols.http.auto import AutoHTTPProtocol

__all__ = ["HEADER_S", "MOST", "MOST_OF_ADDRESS", "held_connections"]

HEADER_S: Final = 10.0
"""Time for a header, s: a phone on a poor link needs one, and a stalled client holds its place no longer."""

MOST: Final = 200
"""Connections at a time; the rest of a process's 1,024 files is for logs and judging processes."""

MOST_OF_ADDRESS: Final = 64
"""Connections of one address: ten open pages of a browser take about 20."""

_BUSY: Final = (
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: text/plain\r\nconnection: close\r\n\r\n"
    b"too many connections; try again in a moment\n"
)


class _Held(AutoHTTPProtocol):  # type: ignore[valid-type,misc]
    """A connection of uvicorn's with these limits; it ends where a websocket takes over."""

    header_s: ClassVar[float] = HEADER_S
    most: ClassVar[int] = MOST
    most_of_address: ClassVar[int] = MOST_OF_ADDRESS

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._begun_s = self.loop.time()
        self._looked_at: object = None
        self._looks: asyncio.TimerHandle | None = self.loop.call_later(self.header_s, self._look)
        others = self.connections - {self}
        own = [each for each in others if _address(each) == _address(self)]
        if len(own) >= self.most_of_address:
            self._make_room(own)
        elif len(others) >= self.most:
            self._make_room(others)

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_looking()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, *given: Any) -> None:
        self._stop_looking()
        super().handle_websocket_upgrade(*given)

    @property
    def waits(self) -> bool:
        """Whether it waits for its client: no request is being answered."""
        return self.cycle is None or bool(self.cycle.response_complete)

    def _look(self) -> None:
        if self.waits and self.cycle is self._looked_at:
            self.transport.abort()
            return
        self._looked_at = self.cycle
        self._looks = self.loop.call_later(self.header_s, self._look)

    def _make_room(self, others: Iterable[Any]) -> None:
        waiting = [each for each in others if isinstance(each, _Held) and each.waits]
        if waiting:
            oldest = min(waiting, key=lambda each: each._begun_s)
            oldest.transport.abort()
            self.connections.discard(oldest)  # it is lost only after this turn of the loop
            return
        self.transport.write(_BUSY)
        self.transport.close()

    def _stop_looking(self) -> None:
        if self._looks is not None:
            self._looks.cancel()
            self._looks = None


def held_connections(
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
    return type("HeldConnection", (_Held,), limits)


def _address(connection: Any) -> str:
    return str(connection.client[0]) if connection.client else ""
