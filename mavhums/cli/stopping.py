"""Decides when to stop a command that otherwise runs without end."""

from __future__ import annotations

import signal
import time
from types import FrameType, TracebackType
from typing import Any, Self

__all__ = ["Stop"]


class Stop:
    """Returns whether to stop: after a time, at Ctrl-C, SIGTERM or SIGHUP; a second signal aborts.

    Until ``begun``, there is nothing to end in order, and a signal ends the program at once. SIGHUP stays
    ignored if the program was started with it ignored (``nohup``).

    Parameters
    ----------
    duration
        Seconds; None for no limit.
    """

    def __init__(self, duration: float | None) -> None:
        self.begun = False
        self._told = False
        self._end = None if duration is None else time.monotonic() + duration
        self._before: dict[int, Any] = {}

    def __call__(self) -> bool:
        """Return whether to stop."""
        return self._told or (self._end is not None and time.monotonic() >= self._end)

    def __enter__(self) -> Self:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            left_alone = name == "SIGHUP" and number and signal.getsignal(number) is signal.SIG_IGN
            if number is not None and not left_alone:
                self._before[number] = signal.signal(number, self._tell)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _tell(self, number: int, frame: FrameType | None) -> None:
        if self._told or not self.begun:
            signal.default_int_handler(number, frame)
        self._told = True
