"""Links over UDP and TCP, and the clock of reception: each piece has the time at which it was received."""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
import struct
import sys
import time
from collections.abc import Callable, Hashable, Iterable
from typing import Protocol

from mavhums.live.address import Address, AddressError
from mavhums.live.outlet import Outgoing
from mavhums.log.mavlink.stamping import Piece

__all__ = ["Link", "ReceiveClock", "TcpLink", "UdpLink"]

_LOG = logging.getLogger(__name__)
_BUFFER = 8 << 20
_LARGEST = 65_535
_AT_ONCE = 4096
_RETRY_US = 1_000_000
# Linux constants; the socket module does not define all of them.
_SO_TIMESTAMPNS, _SO_RXQ_OVFL, _SO_RCVBUFFORCE = 35, 40, 33
_TIMESPEC, _COUNT = struct.Struct("@ll"), struct.Struct("@I")
_ANCILLARY = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_COUNT.size)
_STEP_NS = 50_000_000  # a clock that NTP slews moves less between two looks


def _steady_ns() -> int:
    """Return the time since the computer started, which includes suspended time."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return time.monotonic_ns()


class ReceiveClock:
    """UTC at the start, plus the time elapsed on a steady clock.

    If the computer's clock is set during a session (by NTP, or by GPS), its time steps, which would tear
    the recording apart or turn it back; this clock does not step.

    Parameters
    ----------
    wall_ns, steady_ns
        Clocks in nanoseconds: UTC, which may step, and one that does not.

    Examples
    --------
    >>> walls = iter([1_000_000_000, 99_000_000_000])
    >>> clock = ReceiveClock(lambda: next(walls), lambda: 0)
    >>> clock.now_us(), clock.at_us([98_999_500_000, None])
    (1000000, [999500, 1000000])
    """

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = _steady_ns,
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._offset_ns = self._ahead_ns = self._former_ns = wall_ns() - steady_ns()

    def now_us(self) -> int:
        """Return the present time, microseconds of UTC."""
        return (self._steady_ns() + self._offset_ns) // 1000

    def at_us(self, walls_ns: Iterable[int | None], since_us: int | None = None) -> list[int]:
        """Return the times of recent moments, given in the stepping clock's time; None means now.

        Parameters
        ----------
        walls_ns
            Readings of the stepping clock.
        since_us
            Time at which nothing had arrived yet: no moment lies before it. The default is one second
            ago.

        Notes
        -----
        If the clock was set meanwhile, a moment that is impossible by the present setting is read by the
        former setting.
        """
        steady_ns = self._steady_ns()
        ahead_ns = self._wall_ns() - steady_ns
        now_ns = steady_ns + self._offset_ns
        if abs(ahead_ns - self._ahead_ns) > _STEP_NS:
            self._former_ns = self._ahead_ns
        self._ahead_ns = ahead_ns
        oldest_ns = now_ns - 1_000_000_000 if since_us is None else min(since_us * 1000, now_ns)
        out = []
        for then_ns in walls_ns:
            at_ns = now_ns if then_ns is None else then_ns - ahead_ns + self._offset_ns
            if then_ns is not None and not oldest_ns <= at_ns <= now_ns:
                former_ns = then_ns - self._former_ns + self._offset_ns
                at_ns = former_ns if oldest_ns <= former_ns <= now_ns else at_ns
            out.append(min(max(at_ns, oldest_ns), now_ns) // 1000)
        return out


class Link(Protocol):
    """A link that receives from vehicles and answers them.

    Attributes
    ----------
    address
        Address of the link.
    dropped
        Datagrams that the kernel dropped because they were not read in time.
    stamped
        Whether the kernel reports when each piece was received.
    """

    address: Address
    dropped: int
    stamped: bool

    @property
    def unsent(self) -> int:
        """Frames that could not be sent."""
        ...

    def fileno(self) -> int:
        """Return the descriptor for ``select``; -1 while there is none."""
        ...

    def receive(self) -> list[Piece]:
        """Return the received data, without waiting."""
        ...

    def send(self, data: bytes, heard: Iterable[Hashable]) -> None:
        """Send a frame to those of ``heard`` that are on this link, without waiting.

        Frames that cannot be sent are dropped and counted.
        """
        ...

    def close(self) -> None:
        """Close the link."""
        ...


class UdpLink:
    """A local UDP port (``udpin``), or a UDP connection to a peer (``udpout``)."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        family, target = _resolve(address, socket.SOCK_DGRAM)
        self.dropped = self.unsent = self._latest_us = 0
        self._buffer = memoryview(bytearray(_LARGEST))
        self._clock, self._emptied_us = clock, clock.now_us()
        self._listens = address.kind == "udpin"
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.stamped = _enlarge(self._socket)
        try:
            (self._socket.bind if self._listens else self._socket.connect)(target)
        except OSError as error:
            self._socket.close()
            remedy = "end the program that holds the port, or choose another" if self._listens else ""
            raise AddressError(f"{address}: {error.strerror}", remedy) from error
        port = self._socket.getsockname()[1] if self._listens else address.port
        self.address = Address(address.kind, address.host, port)

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def receive(self) -> list[Piece]:
        """Return the received datagrams, at most a few thousand."""
        came = []
        since_us, began_us = self._emptied_us, self._clock.now_us()
        try:
            for _ in range(_AT_ONCE):
                size, ancillary, _, peer = self._socket.recvmsg_into([self._buffer], _ANCILLARY)
                came.append((peer, self._received_ns(ancillary), bytes(self._buffer[:size])))
        except BlockingIOError:
            self._emptied_us = began_us
        except OSError:
            pass  # the peer's port is closed; it may open again
        pieces = []
        times_us = self._clock.at_us((ns for _, ns, _ in came), since_us)
        for (peer, _, data), time_us in zip(came, times_us, strict=True):
            self._latest_us = max(self._latest_us, time_us)
            pieces.append(Piece((self.address, peer), self._latest_us, data))
        return pieces

    def send(self, data: bytes, heard: Iterable[Hashable]) -> None:
        """Send to the peers heard on this link; ``udpout`` sends to its peer, heard or not."""
        if not self._listens:
            self._try(self._socket.send, data)
            return
        for sender in heard:
            if isinstance(sender, tuple) and sender[0] == self.address:
                self._try(self._socket.sendto, data, sender[1])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _try(self, send: Callable[..., object], *arguments: object) -> None:
        """Send; try once more if the error belongs to an earlier datagram."""
        for _ in range(2):
            try:
                send(*arguments)
            except ConnectionRefusedError:
                continue
            except OSError:
                break
            return
        self.unsent += 1

    def _received_ns(self, ancillary: list[tuple[int, int, bytes]]) -> int | None:
        """Return when a datagram arrived, if the kernel reports it, and note the number of dropped ones."""
        received_ns = None
        for level, kind, content in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack_from(content)
                received_ns = seconds * 1_000_000_000 + nanoseconds
            elif level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                self.dropped = _COUNT.unpack_from(content)[0]
        return received_ns


class TcpLink:
    """A connection to a TCP server, restored after a failure."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        self._family, self._target = _resolve(address, socket.SOCK_STREAM)
        self.address, self.dropped, self.stamped = address, 0, False
        self._clock, self._out = clock, Outgoing()
        self._socket: socket.socket | None = None
        self._connections, self._retry_us, self._told = 0, 0, False
        self._connected = False

    @property
    def unsent(self) -> int:
        """Frames that could not be sent."""
        return self._out.dropped

    def fileno(self) -> int:
        """Return the connection's descriptor, -1 without a connection."""
        return self._socket.fileno() if self._socket and self._connected else -1

    def receive(self) -> list[Piece]:
        """Return the received data; connect first if there is no connection."""
        if self._socket is None or not self._connected:
            self._connect()
        if self._socket is None or not self._connected:
            return []
        self._out.pump(self._socket.send)
        try:
            data = self._socket.recv(1 << 18)
        except BlockingIOError:
            return []
        except OSError as error:
            self._lose(error.strerror or str(error))
            return []
        if not data:
            self._lose("closed by the other end")
            return []
        return [Piece((self.address, self._connections), self._clock.now_us(), data)]

    def send(self, data: bytes, heard: Iterable[Hashable]) -> None:
        """Send to the server."""
        if self._socket is None or not self._connected:
            self._out.refuse()
            return
        self._out.offer(data)
        self._out.pump(self._socket.send)

    def close(self) -> None:
        """Close the connection."""
        self._out.clear()
        if self._socket is not None:
            self._socket.close()
            self._socket, self._connected = None, False

    def _connect(self) -> None:
        """Start to connect, or check whether the connection is established."""
        if self._socket is None:
            if self._clock.now_us() < self._retry_us:
                return
            self._retry_us = self._clock.now_us() + _RETRY_US
            self._socket = socket.socket(self._family, socket.SOCK_STREAM)
            self._socket.setblocking(False)
        code = self._socket.connect_ex(self._target)
        if code in (0, errno.EISCONN):
            self._connected, self._told = True, False
            self._connections += 1
            _LOG.info("%s: connected", self.address)
        elif code not in (errno.EINPROGRESS, errno.EALREADY, errno.EWOULDBLOCK):
            self._lose(errno.errorcode.get(code, str(code)))

    def _lose(self, why: str) -> None:
        self.close()
        if not self._told:
            _LOG.warning("%s: no connection (%s); trying again every second", self.address, why)
            self._told = True


Target = tuple[str, int] | tuple[str, int, int, int]


def _resolve(address: Address, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Target]:
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise AddressError(f"{address}: no such host", "check its name") from error
    family, _, _, _, target = found[0]
    return family, (str(target[0]), int(target[1]), *target[2:])


def _enlarge(link: socket.socket) -> bool:
    """Request a large receive buffer, times of reception, and the number of dropped datagrams.

    Return whether the kernel reports the times.
    """
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    if sys.platform != "linux":
        return False
    for option, value in ((_SO_RCVBUFFORCE, _BUFFER), (_SO_TIMESTAMPNS, 1), (_SO_RXQ_OVFL, 1)):
        with contextlib.suppress(OSError):  # only root may set the first
            link.setsockopt(socket.SOL_SOCKET, option, value)
    return True
