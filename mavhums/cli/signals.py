"""What signals do: they end a program in order, or stop a command that otherwise runs without end."""

from __future__ import annotations

import signal
import sys
import time
from types import FrameType, TracebackType
from typing import Any, Never, Self

__all__ = ["Stop", "end_on_signals", "interrupts_end_silently"]

_BY_SIGNAL = 128


def end_on_signals() -> None:
    """Make SIGTERM and a terminal's SIGHUP end the program in order, and remove unfinished files.

    A signal that the caller ignores, as ``nohup`` does, stays ignored. A command with its own handlers, such
    as ``live``, replaces these.
    """
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)


def interrupts_end_silently() -> None:
    """Let Ctrl-C end the program silently: what it had to do is done, and the interpreter exits."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _end(number: int, _: FrameType | None) -> Never:
    signal.signal(number, signal.SIG_IGN)
    sys.exit(_BY_SIGNAL + number)


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
        self._stopped = False
        self._end = None if duration is None else time.monotonic() + duration
        self._before: dict[int, Any] = {}

    def __call__(self) -> bool:
        """Return whether to stop."""
        return self._stopped or (self._end is not None and time.monotonic() >= self._end)

    def __enter__(self) -> Self:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            left_alone = name == "SIGHUP" and number and signal.getsignal(number) is signal.SIG_IGN
            if number is not None and not left_alone:
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._stopped or not self.begun:
            signal.default_int_handler(number, frame)
        self._stopped = True
