"""Who is told that inner loops are being compiled, which happens once after an installation.

Imports nothing heavy, so that the command line can ask to be told before anything is loaded.
"""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["ask_to_be_told", "tell"]

_listeners: list[Callable[[], None]] = []


def ask_to_be_told(listener: Callable[[], None]) -> None:
    """Let a listener be called whenever a loop begins to be compiled that is not kept on disk."""
    _listeners.append(listener)


def tell() -> None:
    """Tell the listeners that a loop is about to be compiled."""
    for listener in _listeners:
        listener()
