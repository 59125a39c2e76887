"""Detection of a residual that exceeds its limit for some seconds in a row."""

from __future__ import annotations

__all__ = ["Persistent"]


class Persistent:
    """Tracks since when deviations exceed a limit, if they do so for ``seconds`` in a row."""

    def __init__(self, limit: float, seconds: int = 2) -> None:
        self._limit = limit
        self._seconds = seconds
        self._run = 0
        self._since_s = 0

    def feed(self, end_s: int, deviations: float) -> int | None:
        """Return the flight second of the onset if enough in a row exceed the limit; else None."""
        if not deviations > self._limit:
            self._run = 0
            return None
        if self._run == 0:
            self._since_s = end_s - 1
        self._run += 1
        return self._since_s if self._run >= self._seconds else None
