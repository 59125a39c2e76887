"""The time of reception: UTC that never steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

__all__ = ["ReceiveClock"]

_MAX_AGE_US = 1_000_000


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
    >>> clock.now_us(), clock.at_us([98_999_500_000, None])
    (1000000, [999500, 1000000])
    """

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, steady_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._offset_ns = wall_ns() - steady_ns()

    def now_us(self) -> int:
        """Return the present time, microseconds of UTC."""
        return (self._steady_ns() + self._offset_ns) // 1000

    def at_us(self, walls_ns: Iterable[int | None]) -> list[int]:
        """Return the times of moments just past, by what the stepping clock calls them; None is now."""
        wall_ns, now_us = self._wall_ns(), self.now_us()
        return [
            now_us if then_ns is None else now_us - min(max((wall_ns - then_ns) // 1000, 0), _MAX_AGE_US)
            for then_ns in walls_ns
        ]
