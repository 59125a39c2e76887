"""Logs that come to the page: uploaded, taken out of an archive, and kept in a store."""

from __future__ import annotations

import asyncio
import hashlib
import os
import re
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Final, NamedTuple

from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError, UnreadableLogError
from mavhums.core.output import written_whole
from mavhums.core.packed import COMPRESSED, members
from mavhums.core.process_pool import LostItem, in_processes
from mavhums.flights.aircraft import UnnamedAircraftError
from mavhums.log.reader import read_blocks

_MOST_BYTES: Final = 150
_SEPARATORS: Final = re.compile(r"[/\\]")
_LOGS: Final = ".logs"
"""Ends the name of the folder beside a store with the logs that were kept in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quotas:
    """What one user and one log may use.

    Attributes
    ----------
    log_bytes
        Size of a log.
    upload_s
        Time for an upload.
    judge_s, memory_bytes
        Wall-clock time and memory of one judgement; memory is limited on Linux only.
    logs
        Logs of one session.
    sessions
        Sessions that hold a log, at a time.
    session_s
        Time after which the logs of a session without an open page are removed.
    workers
        Processes that judge.
    """

    log_bytes: int = 1 << 30
    upload_s: float = 900.0
    judge_s: float = 300.0
    memory_bytes: int = 2 << 30
    logs: int = 50
    sessions: int = 100
    session_s: float = 1800.0
    workers: int = 2


def safe_name(name: str) -> str:
    r"""Return the last part of a path as a name of a file in one folder, whatever the sender wrote.

    Examples
    --------
    >>> safe_name("../../etc/passwd"), safe_name(r"C:\logs\a.tlog"), safe_name(".."), safe_name("<b>.BIN")
    ('passwd', 'a.tlog', 'log', '<b>.BIN')
    """
    last = _SEPARATORS.split(name)[-1]
    kept = "".join(letter if letter.isprintable() and letter not in ':*?"|' else "_" for letter in last)
    kept = kept.strip(" .")
    while len(kept.encode("utf-8", "replace")) > _MOST_BYTES:
        kept = kept[1:]
    return kept.encode("utf-8", "replace").decode() or "log"


def is_archive(path: Path) -> bool:
    """Return whether a file begins as a zip archive does; one that its user has removed does not."""
    try:
        with path.open("rb") as file:
            return file.read(4) == b"PK\x03\x04"
    except OSError:
        return False


async def receive(stream: AsyncIterator[bytes], target: Path, limits: Quotas) -> int:
    """Write a stream to a new file; return the number of bytes.

    Raises
    ------
    MavhumsError
        If it is empty, too large or too slow; no file remains.
    """
    size = 0
    try:
        with target.open("xb") as file:
            async with asyncio.timeout(limits.upload_s):
                async for part in stream:
                    size += len(part)
                    if size > limits.log_bytes:
                        raise MavhumsError(
                            f"larger than {limits.log_bytes / 1e6:,.0f} MB, the limit of this page",
                            "judge it with `mavhums analyse`, or start `mavhums serve --max-mb`",
                        )
                    await asyncio.to_thread(file.write, part) if len(part) > 1 << 16 else file.write(part)
        if not size:
            raise MavhumsError("the file is empty", "check that the logger has written it")
    except BaseException as error:
        target.unlink(missing_ok=True)
        if isinstance(error, TimeoutError):
            raise MavhumsError("the upload took too long", "check the link and drop it again") from error
        if isinstance(error, OSError):
            raise MavhumsError(
                f"cannot be stored: {error.strerror}", "make room and drop it again"
            ) from error
        raise
    return size


class ArchiveContent(NamedTuple):
    """The logs of an archive, each in a folder of its own, and the names of what is not a log."""

    logs: list[Path]
    others: list[str]


def take_logs(archive: Path, folder: Path, most_bytes: int, most_logs: int) -> ArchiveContent | None:
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
    taken, left = ArchiveContent([], []), most_bytes
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


def keep(options: Options, log: Path, aircraft: str | None = None) -> str:
    """Keep a log in the options' store, in a process of its own; return what was done in one line.

    Raises
    ------
    UnnamedAircraftError
        If the store cannot identify its aircraft, and none is given.
    MavhumsError
        If it cannot be kept.
    """
    named = replace(options, keep=True, aircraft=f"={aircraft}" if aircraft else options.aircraft)
    [done] = in_processes(partial(_kept, named), [log], 1)
    if isinstance(done, LostItem):
        raise MavhumsError("the process that keeps it crashed", "keep it with `mavhums analyse --keep`")
    if isinstance(done, MavhumsError):
        raise done
    return done


def _kept(options: Options, log: Path) -> str | MavhumsError:
    """Copy a log into a folder beside the store and judge it there; a copy that is not kept is removed.

    An error that is returned names neither the copy nor the folder of the store: the page shows it.
    """
    from mavhums.app.analysis import Failed, Judged, judge

    place = str(options.store)
    if "://" in place:
        remedy = "keep it with `mavhums analyse --keep`, where it lies"
        return MavhumsError("a store at an address has no folder for logs", remedy)
    store, copy = Path(place).absolute(), log
    try:
        with log.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        copy = store.with_name(f"{store.name}{_LOGS}") / digest[:16] / log.name
        copy.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(copy, remedy="make room in the store") as temporary:
            shutil.copyfile(log, temporary)
        judged = judge(copy, Settings.read(options))
    except OSError as error:
        return MavhumsError(f"cannot be stored: {error.strerror}", "make room in the store")
    except MavhumsError as error:
        judged = Failed.of(copy, error)
    if isinstance(judged, Judged) and judged.kept:
        return f"kept in the store as {copy.name}; see the fleet"
    if copy is not log:
        _remove(copy)
    if judged.error is None:
        return "the store has this log already; see the fleet"

    def shown(text: str) -> str:
        return text.replace(str(copy), log.name).replace(f"{store.parent}{os.sep}", "")

    problem, remedy = shown(judged.error.problem), shown(judged.error.remedy)
    if isinstance(judged.error, UnnamedAircraftError):
        return UnnamedAircraftError(problem, remedy, judged.error.proposed)
    return MavhumsError(problem, remedy)


def _remove(copy: Path) -> None:
    copy.unlink(missing_ok=True)
    if not any(copy.parent.iterdir()):
        copy.parent.rmdir()
