"""Pauses the search for reference cycles while many small objects are made."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["no_collection"]


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
