"""How the program ends when it is told to from outside: as an exception, so that nothing is left behind."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Never

__all__ = ["heed_signals"]

_BY_SIGNAL = 128


def heed_signals() -> None:
    """Let SIGTERM, and a terminal's SIGHUP, end the program in order; files half-written are removed.

    A signal that the caller ignores, as ``nohup`` does, stays ignored. A command that knows better, such as
    ``live``, sets handlers of its own.
    """
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)


def _end(number: int, _: FrameType | None) -> Never:
    signal.signal(number, signal.SIG_IGN)
    sys.exit(_BY_SIGNAL + number)
