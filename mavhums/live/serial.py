"""A link over a serial device, through pymavlink; it reopens a device that disappears."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Hashable, Iterable
from importlib.util import find_spec
from typing import Any

from mavhums.core.errors import MissingExtraError
from mavhums.live.address import Address, AddressError
from mavhums.live.links import ReceiveClock
from mavhums.live.outlet import Outgoing
from mavhums.log.mavlink.stamping import Piece

__all__ = ["SerialLink"]

_LOG = logging.getLogger(__name__)
_RETRY_US = 1_000_000
_AT_ONCE = 1 << 16


class SerialLink:
    """A radio or an autopilot at a serial device."""

    def __init__(self, address: Address, clock: ReceiveClock) -> None:
        if find_spec("serial") is None:
            raise MissingExtraError("a serial link", "serial")
        self.address, self.dropped, self.stamped = address, 0, False
        self._clock, self._out = clock, Outgoing()
        self._openings, self._retry_us = 0, 0
        self._port: Any = None
        try:
            self._open()
        except OSError as error:
            remedy = "check the device and the permissions (on Linux the group dialout)"
            raise AddressError(f"{address.host}: {error.strerror or error}", remedy) from error

    def fileno(self) -> int:
        """Return the device's descriptor, -1 while the device is absent."""
        return -1 if self._port is None or self._port.fd is None else int(self._port.fd)

    @property
    def unsent(self) -> int:
        """Frames that could not be sent."""
        return self._out.dropped

    def receive(self) -> list[Piece]:
        """Return the received data."""
        if self._port is None:
            self._open_again()
            return []
        self._out.pump(self._write)
        try:
            data = bytes(self._port.port.read(min(self._port.port.in_waiting, _AT_ONCE)))
        except OSError as error:
            _LOG.warning("%s: lost (%s); trying again every second", self.address, error)
            self.close()
            return []
        return [Piece((self.address, self._openings), self._clock.now_us(), data)] if data else []

    def send(self, data: bytes, heard: Iterable[Hashable]) -> None:
        """Write a frame, or the part that the device takes at once."""
        if self._port is None:
            self._out.refuse()
            return
        self._out.offer(data)
        self._out.pump(self._write)

    def close(self) -> None:
        """Close the device; discard its unsent data, because closing would wait for them."""
        self._out.clear()
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
        self._openings += 1

    def _open_again(self) -> None:
        if self._clock.now_us() < self._retry_us:
            return
        self._retry_us = self._clock.now_us() + _RETRY_US
        with contextlib.suppress(OSError):
            self._open()
            _LOG.info("%s: opened again", self.address)
