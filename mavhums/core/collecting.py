"""Reduces the search for reference cycles where many lasting objects are made."""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["collect_seldom", "no_collection"]

_AT_START = 200_000


def collect_seldom() -> None:
    """Let the process start and end without a collection; for programs, not for libraries.

    The modules behind a verdict make 140,000 objects, all of which last until the process ends. Later a
    collection follows every 200,000 new objects, so that a long session still frees its cycles.
    """
    gc.set_threshold(_AT_START)
    atexit.register(_end)


def _end() -> None:
    """Leave all objects to the end of the process; DuckDB's binding complains of those not collected."""
    if "duckdb" in sys.modules:
        gc.unfreeze()
    else:
        gc.freeze()


@contextmanager
def no_collection() -> Iterator[None]:
    """Pause the cyclic garbage collector, which otherwise visits all living objects again and again.

    Afterwards the new objects count as old ones, which only the rare full collections visit. Where the
    program has frozen objects of its own, they stay frozen, and the next collection visits the new ones.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            if not gc.get_freeze_count():
                gc.freeze()
                gc.unfreeze()
            gc.enable()
