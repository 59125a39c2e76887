"""Atomic writing of files; devices and FIFOs are written directly."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file, and move it to ``path`` on success.

    A symbolic link is kept, and its target is replaced. A device or a FIFO is never replaced: the complete
    content is copied into it.

    Raises
    ------
    OSError
        If the file cannot be written; the previous file at ``path`` is then unchanged.
    """
    if path.exists() and not stat.S_ISREG(path.stat().st_mode):
        with tempfile.TemporaryDirectory(prefix="mavhums-sim-") as folder:
            temporary = Path(folder) / path.name
            yield temporary
            with temporary.open("rb") as source, path.open("wb") as target:
                shutil.copyfileobj(source, target)
        return
    place = Path(os.path.realpath(path))
    temporary = place.with_name(f".{place.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(place)
    finally:
        temporary.unlink(missing_ok=True)
