"""The addresses of links that ``mavhums live`` accepts."""

from __future__ import annotations

import ipaddress
import re
from typing import Literal, NamedTuple

from mavhums.core.errors import MavhumsError

__all__ = ["FORMS", "Address", "AddressError"]

FORMS = "udpin:[HOST:]PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE[:BAUD]"
_LOOPBACK = "127.0.0.1"
_NETWORK = re.compile(r"(udpin|udpout|tcp):(?:(\[[^\]]+\]|[^:\[\]]*):)?(\d{1,5})")
_SERIAL = re.compile(r"(?:serial:)?((?:/dev/|COM\d)[^:,]*)(?:[:,](\d+))?")
_BAUD = 57_600


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
