"""Ends the program on a signal with an exception, so that no unfinished file remains."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Never

__all__ = ["heed_signals", "interrupts_end_silently"]

_BY_SIGNAL = 128


def heed_signals() -> None:
    """Make SIGTERM and a terminal's SIGHUP end the program in order, and remove unfinished files.

    A signal that the caller ignores, as ``nohup`` does, stays ignored. A command with its own handlers, such
    as ``live``, replaces these.
    """
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)


def interrupts_end_silently() -> None:
    """Let Ctrl-C end the program without a word: what it had to do is done, and the interpreter exits."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _end(number: int, _: FrameType | None) -> Never:
    signal.signal(number, signal.SIG_IGN)
    sys.exit(_BY_SIGNAL + number)
