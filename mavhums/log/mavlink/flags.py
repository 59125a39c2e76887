"""Bits of ``Table.flags``: how a frame came."""

from __future__ import annotations

__all__ = ["MAVLINK1", "ODD_TIME", "PADDED", "SIGNED"]

MAVLINK1 = 1
SIGNED = 2
"""It bears a signature, which was not verified."""
PADDED = 4
"""Accepted with zeros put back that the sender had trimmed after it computed the CRC."""
ODD_TIME = 8
"""Its time stamp was damaged; its time is that of a neighbour."""
