"""ArduPilot's on-board log: DataFlash (.BIN)."""

from __future__ import annotations

from collections.abc import Collection

from mavhums.log.decoding import LogDecoder, Refusal

__all__ = ["decoder", "refusal"]


def decoder(messages: Collection[str] | None) -> LogDecoder:
    """Return a new decoder of the wanted message types, all if None."""
    raise NotImplementedError


def refusal(head: bytes) -> Refusal | None:
    """Return why a log that begins with ``head`` cannot be read; None if it can."""
    return Refusal(
        "this is an ArduPilot DataFlash log (.BIN), not a MAVLink telemetry log",
        "mavhums reads MAVLink telemetry logs (.tlog); record one with the ground station, or with MAVProxy",
    )
