"""From the bytes of a telemetry log to tables of messages; it knows nothing of servos."""

from __future__ import annotations

from mavhums.log.mavlink.decoder import Decoder
from mavhums.log.reader import Log, decode_blocks, read_blocks, read_log
from mavhums.log.tables import Table

__all__ = ["Decoder", "Log", "Table", "decode_blocks", "read_blocks", "read_log"]
