"""Converts the tables of each log format to the signals of :mod:`mavhums.vehicle.signals`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, Protocol

from mavhums.log import Table
from mavhums.vehicle.signal_readers import dataflash, mavlink, ulog
from mavhums.vehicle.signals import Signal

__all__ = ["MESSAGES", "SignalReaders"]

MESSAGES: Final = mavlink.MESSAGES | dataflash.MESSAGES | ulog.MESSAGES
"""Messages of any format that tell signals."""


class _Reader(Protocol):
    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]: ...


class SignalReaders:
    """Reads signals from the tables of any format, block by block."""

    def __init__(self) -> None:
        self._readers: tuple[_Reader, ...] = (
            mavlink.MavlinkSignals(),
            dataflash.DataFlashSignals(),
            ulog.UlogSignals(),
        )

    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the signals of these tables."""
        for reader in self._readers:
            yield from reader.read(tables)
