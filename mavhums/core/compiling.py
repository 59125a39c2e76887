"""Notification of kernel compilation, which happens once after an installation.

This module imports nothing heavy, so that the command line can register before it loads anything.
"""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["notify", "on_compile"]

_listeners: list[Callable[[], None]] = []


def on_compile(listener: Callable[[], None]) -> None:
    """Register a listener that is called when the compilation of an uncached kernel begins."""
    _listeners.append(listener)


def notify() -> None:
    """Notify the listeners that a compilation begins."""
    for listener in _listeners:
        listener()
