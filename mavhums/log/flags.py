"""Bits of ``Table.flags``: how a frame was received."""

from __future__ import annotations

__all__ = ["LOOSE_TIME", "MAVLINK1", "ODD_TIME", "PADDED", "SIGNED"]

MAVLINK1 = 1
SIGNED = 2
"""The frame has a signature, which was not verified."""
PADDED = 4
"""The CRC matched only with restored zeros, which the sender trimmed after it computed the CRC."""
ODD_TIME = 8
"""The time stamp was damaged; the time is that of a neighbouring frame."""
LOOSE_TIME = 16
"""The message has no stamp, and its sender's stamped ones arrive with latencies more than 0.5 s apart."""
