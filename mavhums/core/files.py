"""Files that appear whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from mavhums.core.errors import MavhumsError

__all__ = ["written_whole"]


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give the path of a temporary file, and rename it to ``path`` if all goes well.

    Raises
    ------
    MavhumsError
        If the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{token_hex(4)}.part")
    try:
        try:
            yield temporary
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise MavhumsError(
            f"cannot write {path}: {error.strerror or error}", "choose another place"
        ) from error
