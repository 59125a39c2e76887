"""Atomic writing of files."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from mavhums.core.errors import MavhumsError

__all__ = ["WholeFile", "written_whole"]


class WholeFile:
    """A temporary file that replaces its target when it is complete.

    A regular file is replaced by rename and keeps its permissions. A symbolic link is kept, and its target
    is replaced. A device, a FIFO or a socket is never replaced: the complete content is copied into it.

    Parameters
    ----------
    path
        Path of the target.

    Attributes
    ----------
    temporary
        Path for writing; a new path, without a file.

    Raises
    ------
    OSError
        If ``path`` is a folder.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._mode = _mode(self._path)
        self._through = self._mode is not None and not stat.S_ISREG(self._mode)
        if self._through:
            self.temporary = Path(tempfile.mkdtemp(prefix="mavhums-")) / self._path.name
        else:
            self._path = Path(os.path.realpath(self._path))
            self.temporary = self._path.with_name(f".{self._path.name[:200]}.{token_hex(4)}.part")

    def publish(self) -> None:
        """Move the complete file to its target.

        Raises
        ------
        OSError
            If that fails; a regular target file is then unchanged.
        """
        if self._through:
            with self.temporary.open("rb") as source, self._path.open("wb") as target:
                shutil.copyfileobj(source, target)
            return
        if self._mode is not None:
            self.temporary.chmod(stat.S_IMODE(self._mode))
        self.temporary.replace(self._path)

    def discard(self) -> None:
        """Remove the temporary file; no effect after :meth:`publish`."""
        self.temporary.unlink(missing_ok=True)
        if self._through:
            shutil.rmtree(self.temporary.parent, ignore_errors=True)


@contextmanager
def written_whole(
    path: str | os.PathLike[str],
    *,
    error: type[MavhumsError] = MavhumsError,
    remedy: str = "choose another place",
) -> Iterator[Path]:
    """Yield the path of a temporary file, and move it to ``path`` on success (:class:`WholeFile`).

    Parameters
    ----------
    path
        Path of the target.
    error, remedy
        Type and remedy of the error if it cannot be written.

    Raises
    ------
    MavhumsError
        If the file cannot be written.
    """
    try:
        file = WholeFile(path)
        try:
            yield file.temporary
            file.publish()
        finally:
            file.discard()
    except OSError as problem:
        raise error(f"cannot write {path}: {problem.strerror or problem}", remedy) from problem


def _mode(path: Path) -> int | None:
    """Return type and permissions of the file at a path; None if there is none."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(21, "is a folder")
    return mode
