"""The time of reception: UTC that never steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

__all__ = ["ReceiveClock"]

_STEP_NS = 50_000_000


def _steady_ns() -> int:
    """Return the time since the computer started, which goes on while it is suspended."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return time.monotonic_ns()


class ReceiveClock:
    """UTC as it was at the start, plus what a steady clock says has passed.

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
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = _steady_ns,
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._offset_ns = self._ahead_ns = self._former_ns = wall_ns() - steady_ns()

    def now_us(self) -> int:
        """Return the present time, microseconds of UTC."""
        return (self._steady_ns() + self._offset_ns) // 1000

    def at_us(self, walls_ns: Iterable[int | None], since_us: int | None = None) -> list[int]:
        """Return the times of moments just past, by what the stepping clock calls them; None is now.

        Parameters
        ----------
        walls_ns
            What the stepping clock showed.
        since_us
            When there was nothing to tell yet: none of the moments lies before it. Omitted, a second
            ago.

        Notes
        -----
        Where the clock was set meanwhile, a moment that cannot be by the clock as it is now is taken
        as one by the clock as it was.
        """
        steady_ns = self._steady_ns()
        ahead_ns = self._wall_ns() - steady_ns
        now_ns = steady_ns + self._offset_ns
        if abs(ahead_ns - self._ahead_ns) > _STEP_NS:
            self._former_ns = self._ahead_ns
        self._ahead_ns = ahead_ns
        oldest_ns = now_ns - 1_000_000_000 if since_us is None else min(since_us * 1000, now_ns)
        out = []
        for then_ns in walls_ns:
            at_ns = now_ns if then_ns is None else then_ns - ahead_ns + self._offset_ns
            if then_ns is not None and not oldest_ns <= at_ns <= now_ns:
                former_ns = then_ns - self._former_ns + self._offset_ns
                at_ns = former_ns if oldest_ns <= former_ns <= now_ns else at_ns
            out.append(min(max(at_ns, oldest_ns), now_ns) // 1000)
        return out
