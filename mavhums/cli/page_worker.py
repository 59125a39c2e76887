"""The process that judges logs for the page of a store: by the flights of their aircraft in it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mavhums.flights.store import is_store
from mavhums.serve.worker import main

if TYPE_CHECKING:
    from mavhums.app.options import Options

__all__ = ["among"]


def among(store: Path, log: str, options: Options) -> Options:
    """Return the options for a log among the flights in a store; a folder that is none yet has no flights."""
    if not is_store(store):
        return options
    from mavhums.fleet import against

    return against(log, store, options)


if __name__ == "__main__":
    main(int(sys.argv[1]), lambda log, options: among(Path(sys.argv[2]), log, options))
