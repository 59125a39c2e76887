"""The time of reception: UTC without steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

__all__ = ["ReceiveClock"]

_STEP_NS = 50_000_000


def _steady_ns() -> int:
    """Return the time since the computer started, which includes suspended time."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return time.monotonic_ns()


class ReceiveClock:
    """UTC at the start, plus the time elapsed on a steady clock.

    If the computer's clock is set during a session (by NTP, or by GPS), its time steps, which would tear
    the recording apart or turn it back; this clock does not step.

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
        """Return the times of recent moments, given in the stepping clock's time; None means now.

        Parameters
        ----------
        walls_ns
            Readings of the stepping clock.
        since_us
            Time at which nothing had arrived yet: no moment lies before it. The default is one second
            ago.

        Notes
        -----
        If the clock was set meanwhile, a moment that is impossible by the present setting is read by the
        former setting.
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
