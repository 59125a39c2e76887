"""Detection of a residual that exceeds its limit for two seconds in a row."""

from __future__ import annotations

__all__ = ["Persistent"]


class Persistent:
    """Tracks since when deviations exceed a limit."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._run = 0
        self._since_s = 0

    def feed(self, end_s: int, deviations: float) -> int | None:
        """Return the flight second of the onset if two in a row exceed the limit; else None."""
        if not deviations > self._limit:
            self._run = 0
            return None
        if self._run == 0:
            self._since_s = end_s - 1
        self._run += 1
        return self._since_s if self._run >= 2 else None
