"""ArduPilot's on-board log: DataFlash (.BIN)."""

from __future__ import annotations

from collections.abc import Collection

from mavhums.log.dataflash.decoder import DataFlashDecoder
from mavhums.log.dataflash.refusals import refusal

__all__ = ["DataFlashDecoder", "decoder", "refusal"]


def decoder(messages: Collection[str] | None) -> DataFlashDecoder:
    """Return a new decoder of the wanted message types, all if None."""
    return DataFlashDecoder(messages)
