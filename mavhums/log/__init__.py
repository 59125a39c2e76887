"""Converts the bytes of a telemetry log to tables of messages, independently of servos."""

from __future__ import annotations

from mavhums.log.decoding import Decoder, LogDecoder
from mavhums.log.reader import Log, decode_blocks, read_blocks, read_log
from mavhums.log.tables import Table

__all__ = ["Decoder", "Log", "LogDecoder", "Table", "decode_blocks", "read_blocks", "read_log"]
