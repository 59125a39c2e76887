"""Takes the logs out of a dropped archive; what else is in it is named."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import NamedTuple

from mavhums.core.errors import MavhumsError, UnreadableLogError
from mavhums.core.packed import COMPRESSED, members
from mavhums.log.reader import read_blocks
from mavhums.serve.uploads import safe_name

__all__ = ["Taken", "take_logs"]


class Taken(NamedTuple):
    """The logs of an archive, each in a folder of its own, and the names of what is no log."""

    logs: list[Path]
    others: list[str]


def take_logs(archive: Path, folder: Path, most_bytes: int, most_logs: int) -> Taken | None:
    """Write each log in an archive to a folder of its own; return None if it holds one file alone.

    Parameters
    ----------
    archive
        A zip archive.
    folder
        Where the logs go; it need not exist.
    most_bytes
        Largest size of all logs together, unpacked.
    most_logs
        How many logs are taken; further ones are named.

    Raises
    ------
    MavhumsError
        If the archive is damaged, or its logs are too large.
    """
    names = [info.filename for info in members(archive)]
    if len(names) == 1:
        return None
    taken, left = Taken([], []), most_bytes
    for name in names:
        if len(taken.logs) == most_logs or not _is_inside(name):
            taken.others.append(name)
            continue
        target = folder / str(len(taken.logs)) / _plain(name)
        try:
            left -= _copy(archive / name, target, left)
        except UnreadableLogError:
            target.unlink(missing_ok=True)
            taken.others.append(name)
        else:
            taken.logs.append(target)
    return taken


def _is_inside(name: str) -> bool:
    """Return whether a member's name, joined to the path of the archive, stays in it."""
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and "\\" not in name and ":" not in name


def _plain(name: str) -> str:
    """Return the name of a log without the suffix of its compression, which reading undoes."""
    plain = safe_name(name)
    suffix = Path(plain).suffix.lower()
    return Path(plain).stem if suffix in COMPRESSED else plain


def _copy(source: Path, target: Path, most_bytes: int) -> int:
    """Write a log to a file, if it is one, and return its size."""
    size = 0
    target.parent.mkdir(parents=True, mode=0o700, exist_ok=True)
    with target.open("wb") as file:
        for block in read_blocks(source):
            size += len(block)
            if size > most_bytes:
                problem = f"its logs are larger than the {most_bytes / 1e6:,.0f} MB that this page takes"
                raise MavhumsError(problem, "unpack it, and drop fewer logs")
            file.write(block)
    return size
