"""The end of the program after a signal: in order if possible, in time in any case."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from typing import Final

from mavhums.core.output import remove_unfinished

_PATIENCE_S: Final = 4.0
_ENDING: Final = ("SIGINT", "SIGTERM", "SIGHUP")

_in_order = False
_received: list[int] = []


def signal_received() -> int | None:
    """Return the signal that ends the program; None if it goes on."""
    return _received[-1] if _received else None


def open_closed_streams() -> None:
    """Open the null device in place of streams that were closed; a file would take their numbers."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8", closefd=False))  # noqa: SIM115


def end_in_time() -> None:
    """End the program some seconds after a signal, whatever it waits for: a pipe, a reader, a network.

    Python handles a signal once the main thread runs again, which it may never do; the number of the signal
    is written to a socket at once, and a thread waits there.
    """
    open_closed_streams()  # before the socket takes their numbers
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(receiver, sender), daemon=True).start()


def first_ends_in_order(*, begun: bool) -> None:
    """Leave the first signal to a session that ends in order, in its own time; the next one counts."""
    global _in_order  # noqa: PLW0603 — the process has one way to end
    _in_order = begun


def _watch(receiver: socket.socket, _: socket.socket) -> None:
    numbers = [getattr(signal, name, None) for name in _ENDING]
    while True:
        [number] = receiver.recv(1)
        if number not in numbers:
            continue
        if _in_order:
            first_ends_in_order(begun=False)
            continue
        _received.append(number)
        time.sleep(_PATIENCE_S)
        remove_unfinished()
        os._exit(128 + number)
