"""The time of reception: UTC that never steps."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["ReceiveClock"]


class ReceiveClock:
    """UTC as it was at the start, plus what a monotonic clock says has passed.

    A computer whose clock is set while it listens (by NTP, or by GPS) would tear a gap into the
    recording, or turn it back; this clock does not notice.

    Parameters
    ----------
    wall_ns, steady_ns
        Clocks in nanoseconds: UTC, which may step, and one that does not.

    Examples
    --------
    >>> walls = iter([1_000_000_000, 99_000_000_000])
    >>> clock = ReceiveClock(lambda: next(walls), lambda: 0)
    >>> clock.now_us(), clock.at_us(98_999_500_000)
    (1000000, 999500)
    """

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, steady_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._offset_ns = wall_ns() - steady_ns()

    def now_us(self) -> int:
        """Return the present time, microseconds of UTC."""
        return (self._steady_ns() + self._offset_ns) // 1000

    def at_us(self, wall_ns: int) -> int:
        """Return the time of a moment just past that the stepping clock calls ``wall_ns``."""
        age_us = (self._wall_ns() - wall_ns) // 1000
        return self.now_us() - min(max(age_us, 0), 1_000_000)
