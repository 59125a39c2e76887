"""Links over TCP and serial devices, which are restored after a failure; the frames that wait for them."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable
from importlib.util import find_spec
from typing import Any, Final

from mavhums.core.errors import MissingExtraError
from mavhums.live.links import Address, AddressError, ReceiveClock, resolve
from mavhums.live.outlet import BoundedQueue
from mavhums.log.mavlink.stamping import Piece

_LOG = logging.getLogger(__name__)
_RETRY_US: Final = 1_000_000
_AT_ONCE: Final = 1 << 16
_STREAM_ROOM: Final = 4096  # bytes: a second of alerts; older ones say nothing about the present


class Outgoing:
    """Frames for a stream that may stall, a few kilobytes; when full, the oldest one not begun is dropped.

    Examples
    --------
    >>> out, sent = Outgoing(), []
    >>> out.offer(b"frame")
    >>> out.pump(lambda data: sent.append(bytes(data)) or len(data))
    >>> sent
    [b'frame']
    """

    def __init__(self) -> None:
        self._frames: BoundedQueue[bytes] = BoundedQueue(_STREAM_ROOM)
        self._begun = b""
        self._refused = 0

    @property
    def dropped(self) -> int:
        """Number of frames that were not sent completely."""
        return self._frames.dropped + self._refused

    def offer(self, frame: bytes) -> None:
        """Queue a frame."""
        self._frames.put(frame, len(frame))

    def refuse(self) -> None:
        """Count a frame without a destination."""
        self._refused += 1

    def pump(self, write: Callable[[bytes], int]) -> None:
        """Write as much as possible; ``write`` returns how many bytes it took, or raises."""
        try:
            while self._begun or self._frames:
                if not self._begun:
                    self._begun = self._frames.pop()
                taken = write(self._begun)
                if not taken:
                    return
                self._begun = self._begun[taken:]
        except OSError:
            return  # full or broken: the reading side detects it

    def clear(self) -> None:
        """Drop everything after the stream has ended."""
        self._refused += bool(self._begun)
        self._frames.clear()
        self._begun = b""


class _StreamLink(ABC):
    """A connection over which frames may wait; frames without a connection are lost and counted."""

    stamped = False
    dropped = 0

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        self.address, self._clock = address, clock
        self._out, self._connected = Outgoing(), False
        self._connections = self._retry_us = 0

    @property
    def unsent(self) -> int:
        """Frames that could not be sent."""
        return self._out.dropped

    def send(self, data: bytes, heard: Iterable[Hashable]) -> None:
        """Send a frame, or the part that the connection takes at once."""
        if not self._connected:
            self._out.refuse()
            return
        self._out.offer(data)
        self._out.pump(self._write)

    def close(self) -> None:
        """Close the connection; what it has not sent is lost."""
        self._out.clear()
        self._connected = False

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Write without waiting; return the number of written bytes."""

    def _may_retry(self) -> bool:
        """Return whether a second has passed since the last attempt to connect, and begin another one."""
        now_us = self._clock.now_us()
        if now_us < self._retry_us:
            return False
        self._retry_us = now_us + _RETRY_US
        return True

    def _pieces(self, data: bytes) -> list[Piece]:
        return [Piece((self.address, self._connections), self._clock.now_us(), data)] if data else []


class TcpLink(_StreamLink):
    """A connection to a TCP server."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        super().__init__(address, clock)
        self._family, self._target = resolve(address, socket.SOCK_STREAM)
        self._socket: socket.socket | None = None
        self._warned = False

    def fileno(self) -> int:
        """Return the connection's descriptor, -1 without a connection."""
        return self._socket.fileno() if self._socket and self._connected else -1

    def receive(self) -> list[Piece]:
        """Return the received data; connect first if there is no connection."""
        if not self._connected:
            self._connect()
        if not self._connected:
            return []
        assert self._socket
        self._out.pump(self._write)
        try:
            data = self._socket.recv(1 << 18)
        except BlockingIOError:
            return []
        except OSError as error:
            self._lose(error.strerror or str(error))
            return []
        if not data:
            self._lose("closed by the other end")
        return self._pieces(data)

    def close(self) -> None:
        """Close the connection; what it has not sent is lost."""
        super().close()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _write(self, data: bytes) -> int:
        assert self._socket
        return self._socket.send(data)

    def _connect(self) -> None:
        """Start to connect, or check whether the connection is established."""
        if self._socket is None:
            if not self._may_retry():
                return
            self._socket = socket.socket(self._family, socket.SOCK_STREAM)
            self._socket.setblocking(False)
        code = self._socket.connect_ex(self._target)
        if code in (0, errno.EISCONN):
            self._connected, self._warned = True, False
            self._connections += 1
            _LOG.info("%s: connected", self.address)
        elif code not in (errno.EINPROGRESS, errno.EALREADY, errno.EWOULDBLOCK):
            self._lose(errno.errorcode.get(code, str(code)))

    def _lose(self, why: str) -> None:
        self.close()
        if not self._warned:
            _LOG.warning("%s: no connection (%s); trying again every second", self.address, why)
            self._warned = True


class SerialLink(_StreamLink):
    """A radio or an autopilot at a serial device, through pymavlink."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        if find_spec("serial") is None:
            raise MissingExtraError("a serial link", "serial")
        super().__init__(address, clock)
        self._port: Any = None
        try:
            self._open()
        except OSError as error:
            remedy = "check the device and the permissions (on Linux the group dialout)"
            raise AddressError(f"{address.host}: {error.strerror or error}", remedy) from error

    def fileno(self) -> int:
        """Return the device's descriptor, -1 while the device is absent."""
        return -1 if self._port is None or self._port.fd is None else int(self._port.fd)

    def receive(self) -> list[Piece]:
        """Return the received data."""
        if self._port is None:
            if self._may_retry():
                with contextlib.suppress(OSError):
                    self._open()
                    _LOG.info("%s: opened again", self.address)
            return []
        self._out.pump(self._write)
        try:
            data = bytes(self._port.port.read(min(self._port.port.in_waiting, _AT_ONCE)))
        except OSError as error:
            _LOG.warning("%s: lost (%s); trying again every second", self.address, error)
            self.close()
            return []
        return self._pieces(data)

    def close(self) -> None:
        """Close the device; discard its unsent data, because closing would wait for them."""
        super().close()
        if self._port is not None:
            with contextlib.suppress(Exception):  # termios has its own error type
                self._port.port.reset_output_buffer()
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None

    def _write(self, data: bytes) -> int:
        """Write without waiting; pyserial would wait, whatever its time-out."""
        if os.name == "posix":
            return os.write(self._port.fd, data)
        return int(self._port.port.write(data) or 0)

    def _open(self) -> None:
        from pymavlink.mavutil import mavserial

        self._port = mavserial(self.address.host, baud=self.address.port)
        self._port.port.write_timeout = 0
        self._connected = True
        self._connections += 1
