"""Receives a log from the browser into a file, within limits of size and time."""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from mavhums.core.errors import MavhumsError
from mavhums.serve.options import Limits

__all__ = ["hold_size", "is_archive", "receive", "safe_name"]

_MOST_BYTES: Final = 150
_SEPARATORS: Final = re.compile(r"[/\\]")
_SPARE: Final = 256 << 20


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


def hold_size(size: int, folder: Path, limits: Limits) -> None:
    """Refuse a log that is too large, or for which there is no room.

    Raises
    ------
    MavhumsError
        If it is.
    """
    if size > limits.log_bytes:
        problem = f"larger than {limits.log_bytes / 1e6:,.0f} MB, the limit of this page"
        raise MavhumsError(problem, "judge it with `mavhums analyse`, or start `mavhums serve --max-mb`")
    if size + _SPARE > shutil.disk_usage(folder).free:
        raise MavhumsError("no room for it on the disk of the page's computer", "make room and drop it again")


def is_archive(path: Path) -> bool:
    """Return whether a file begins as a zip archive does; one that its user has removed does not."""
    try:
        with path.open("rb") as file:
            return file.read(4) == b"PK\x03\x04"
    except OSError:
        return False


async def receive(stream: AsyncIterator[bytes], target: Path, limits: Limits) -> int:
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
                while True:
                    async with asyncio.timeout(limits.silence_s):
                        part = await anext(stream, None)
                    if part is None:
                        break
                    size += len(part)
                    if size > limits.log_bytes:
                        hold_size(size, target.parent, limits)
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
