"""TCP and serial links: streams that are restored after a failure."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

from mavhums.core.errors import MissingExtraError
from mavhums.live.links import Address, AddressError, ReceiveClock, resolve
from mavhums.live.outlet import BoundedQueue
from mavhums.log.mavlink.stamping import Piece

_LOG = logging.getLogger(__name__)
_RETRY_US: Final = 1_000_000
_BYTES_AT_ONCE: Final = 1 << 16
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
    """A connection that is made again when it breaks, tried at most once a second.

    Frames may wait in it; those without a connection are lost and counted.
    """

    stamped = False
    dropped = 0

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        self.address, self._clock = address, clock
        self._out, self._connected, self._warned = Outgoing(), False, False
        self._connections = self._retry_us = 0
        self._file = -1

    @property
    def unsent(self) -> int:
        """Frames that could not be sent."""
        return self._out.dropped

    def fileno(self) -> int:
        """Return the connection's descriptor, -1 without a connection."""
        return self._file

    def receive(self) -> list[Piece]:
        """Return the received data; connect first if there is no connection."""
        try:
            if not self._connected and not self._connect():
                return []
            self._out.pump(self._write)
            data = self._read()
        except BlockingIOError:
            return []
        except OSError as error:
            self.close()
            if not self._warned:
                why = error.strerror or error
                _LOG.warning("%s: no connection (%s); trying again every second", self.address, why)
                self._warned = True
            return []
        return [Piece((self.address, self._connections), self._clock.now_us(), data)] if data else []

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
        self._shut()
        self._connected, self._file = False, -1

    def _connect(self) -> bool:
        """Return whether there is a connection now."""
        self._connected = self._open()
        if self._connected:
            self._connections += 1
            self._warned = False
            _LOG.info("%s: connected", self.address)
        return self._connected

    def _may_retry(self) -> bool:
        """Return whether a second has passed since the last attempt to connect, and begin another one."""
        now_us = self._clock.now_us()
        if now_us < self._retry_us:
            return False
        self._retry_us = now_us + _RETRY_US
        return True

    @abstractmethod
    def _open(self) -> bool:
        """Connect, or continue to, without waiting; return whether it is connected."""

    @abstractmethod
    def _shut(self) -> None:
        """Close what is open, if anything."""

    @abstractmethod
    def _read(self) -> bytes:
        """Read without waiting."""

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Write without waiting; return the number of written bytes."""


class TcpLink(_StreamLink):
    """A connection to a TCP server."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        super().__init__(address, clock)
        self._family, self._target = resolve(address, socket.SOCK_STREAM)
        self._socket: Any = None

    def _open(self) -> bool:
        if self._socket is None:
            if not self._may_retry():
                return False
            self._socket = socket.socket(self._family, socket.SOCK_STREAM)
            self._socket.setblocking(False)
        code = self._socket.connect_ex(self._target)
        if code not in (0, errno.EISCONN, errno.EINPROGRESS, errno.EALREADY, errno.EWOULDBLOCK):
            raise OSError(code, os.strerror(code))
        self._file = self._socket.fileno() if code in (0, errno.EISCONN) else -1
        return self._file >= 0

    def _shut(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _read(self) -> bytes:
        data: bytes = self._socket.recv(1 << 18)
        if not data:
            raise ConnectionError("closed by the other end")
        return data

    def _write(self, data: bytes) -> int:
        return int(self._socket.send(data))


class SerialLink(_StreamLink):
    """A radio or an autopilot at a serial device."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        if find_spec("serial") is None:
            raise MissingExtraError("a serial link", "serial")
        super().__init__(address, clock)
        self._port: Any = None
        try:
            self._connect()
        except OSError as error:
            remedy = "check the device and the permissions (on Linux the group dialout)"
            raise AddressError(f"{address.host}: {error.strerror or error}", remedy) from error

    def _open(self) -> bool:
        if not self._may_retry():
            return False
        # Some kernels set a rate only where it changes, so the first one is another, as of pymavlink.
        self._port = import_module("serial").Serial(self.address.host, 1200, timeout=0, write_timeout=0)
        self._port.baudrate = self.address.port
        self._file = self._port.fileno() if os.name == "posix" else -1
        return True

    def _shut(self) -> None:
        """Close the device; discard its unsent data, because closing would wait for them."""
        if self._port is not None:
            with contextlib.suppress(Exception):  # termios has its own error type
                self._port.reset_output_buffer()
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None

    def _read(self) -> bytes:
        return bytes(self._port.read(min(self._port.in_waiting, _BYTES_AT_ONCE)))

    def _write(self, data: bytes) -> int:
        """Write without waiting; pyserial would wait, whatever its time-out."""
        return int(os.write(self._file, data) if os.name == "posix" else self._port.write(data) or 0)
