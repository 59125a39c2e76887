"""Links: their addresses, the clock of reception, and UDP."""

from __future__ import annotations

import contextlib
import ipaddress
import re
import socket
import struct
import sys
import time
from collections.abc import Callable, Hashable, Iterable
from typing import Literal, NamedTuple, Protocol

from mavhums.core.errors import MavhumsError
from mavhums.log.mavlink.stamping import Piece

FORMS = "udpin:[HOST:]PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE[:BAUD]"
_LOOPBACK = "127.0.0.1"
_NETWORK = re.compile(r"(udpin|udpout|tcp):(?:(\[[^\]]+\]|[^:\[\]]*):)?(\d{1,5})")
_SERIAL = re.compile(r"(?:serial:)?((?:/dev/|COM\d)[^:,]*)(?:[:,](\d+))?")
_BAUD = 57_600
_BUFFER = 8 << 20
_LARGEST = 65_535
_AT_ONCE = 4096
# Linux constants; the socket module does not define all of them.
_SO_TIMESTAMPNS, _SO_RXQ_OVFL, _SO_RCVBUFFORCE = 35, 40, 33
_TIMESPEC, _COUNT = struct.Struct("@ll"), struct.Struct("@I")
_ANCILLARY = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_COUNT.size)


class AddressError(MavhumsError):
    """The address cannot be reached or bound."""


class Address(NamedTuple):
    """One end of a link.

    Attributes
    ----------
    kind
        ``udpin`` binds a port, ``udpout`` and ``tcp`` connect to one, ``serial`` opens a device.
    host
        Host name or address; for ``serial``, the device.
    port
        Port number; for ``serial``, the baud rate.
    """

    kind: Literal["udpin", "udpout", "tcp", "serial"]
    host: str
    port: int

    @classmethod
    def parse(cls, url: str) -> Address:
        """Return the address in a URL; a port to bind is on the loopback unless the URL names a host.

        Raises
        ------
        AddressError
            If the URL has none of the accepted forms.

        Examples
        --------
        >>> Address.parse("udpin:14550")
        Address(kind='udpin', host='127.0.0.1', port=14550)
        >>> str(Address.parse("/dev/ttyUSB0"))
        'serial:/dev/ttyUSB0:57600'
        """
        if serial := _SERIAL.fullmatch(url):
            return cls("serial", serial[1], int(serial[2] or _BAUD))
        if network := _NETWORK.fullmatch(url):
            kind, host, port = network[1], (network[2] or "").strip("[]"), int(network[3])
            if kind == "udpin" and port <= 65_535:
                return cls("udpin", host or _LOOPBACK, port)
            if host and 0 < port <= 65_535:
                return cls("tcp" if kind == "tcp" else "udpout", host, port)
        meant = f"udpin:{url.removeprefix('udp:').removeprefix(':')}"
        guess = f"did you mean {meant}? " if _NETWORK.fullmatch(meant) else ""
        raise AddressError(f"{url!r} is not the address of a link", f"{guess}it must be {FORMS}")

    @property
    def exposed(self) -> bool:
        """Whether it binds a port that other machines can reach."""
        if self.kind != "udpin":
            return False
        try:
            return not ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host != "localhost"

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}:{host}:{self.port}"


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
        self._offset_ns = wall_ns() - steady_ns()

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
        If the clock was set meanwhile, a moment may be impossible: then it is the nearest possible one.
        """
        now_ns = self._steady_ns() + self._offset_ns
        shift_ns = now_ns - self._wall_ns()
        oldest_ns = now_ns - 1_000_000_000 if since_us is None else min(since_us * 1000, now_ns)
        times_ns = (now_ns if then_ns is None else then_ns + shift_ns for then_ns in walls_ns)
        return [min(max(time_ns, oldest_ns), now_ns) // 1000 for time_ns in times_ns]


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
        family, target = resolve(address, socket.SOCK_DGRAM)
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
            remedy = "end the program that uses the port, or choose another" if self._listens else ""
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


Target = tuple[str, int] | tuple[str, int, int, int]


def resolve(address: Address, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Target]:
    """Return the family and the socket address of a host."""
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
