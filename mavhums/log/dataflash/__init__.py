"""ArduPilot's on-board log: DataFlash (.BIN)."""

from __future__ import annotations

from mavhums.log.base.decoder import Refusal
from mavhums.log.dataflash.decoder import DataFlashDecoder
from mavhums.log.dataflash.scanner import RecordScanner
from mavhums.log.formats import pieces

__all__ = ["DataFlashDecoder", "decoder", "refusal"]


decoder = DataFlashDecoder

_OLD = {
    b"TimeMS": "this DataFlash log is older than TimeUS (ArduPilot of before 2015)",
    b"StartTime": "this is a log of PX4 from before ULog (sdlog2)",
}
"""The name of the time in records of formats that are no more."""


def refusal(head: bytes) -> Refusal | None:
    """Return why a log that begins with ``head`` cannot be read; None if it can."""
    scanner = RecordScanner()
    columns: list[list[bytes]] = []
    # Definitions come first: the rest of the megabyte is scanned only where none of them has a time.
    for piece, final in pieces(head):
        scanner.feed(piece, final=final)
        columns = [body[22:].tobytes().split(b"\0")[0].split(b",") for body in scanner.bodies[1:]]
        if any(fields[0] == b"TimeUS" for fields in columns):
            return None
    for column, problem in _OLD.items():
        if any(column in fields for fields in columns):
            remedy = "update the autopilot's firmware, or judge the telemetry log (.tlog) of the flight"
            return Refusal(problem, remedy)
    return Refusal(
        "this DataFlash log does not define its records (no FMT in its first megabyte)",
        "in a copy, put the first 20 kB of another log of the same firmware before it",
    )
