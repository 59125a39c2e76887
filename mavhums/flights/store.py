"""Tells a fleet's store from a folder of one aircraft's flights."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["is_store"]


def is_store(place: str | os.PathLike[str]) -> bool:
    """Return whether a place is a fleet's store: a folder with its tables, or an object store's address.

    Examples
    --------
    >>> is_store("s3://bucket/fleet"), is_store("flights")
    (True, False)
    """
    return "://" in os.fspath(place) or Path(place, "logs", "_delta_log").exists()
