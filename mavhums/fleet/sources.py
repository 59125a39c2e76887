"""The logs that a user names: files, folders and patterns, on disk or in an object store.

A log in an object store has its address as its path. It is downloaded for its judgement only.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from glob import glob, has_magic
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

from mavhums.core.errors import MavhumsError, MissingExtraError, UnreadableLogError
from mavhums.core.packed import ARCHIVES, COMPRESSED, members
from mavhums.flights.store import LogFile
from mavhums.log.formats import SUFFIXES

if TYPE_CHECKING:
    from pyarrow.fs import FileInfo, FileSystem

_PACKED: Final = "|".join(map(re.escape, COMPRESSED))
_LOG: Final = re.compile(rf".+({'|'.join(map(re.escape, SUFFIXES))})({_PACKED})?", re.IGNORECASE)
_ARCHIVE: Final = re.compile(rf".+({'|'.join(map(re.escape, ARCHIVES))})", re.IGNORECASE)
_ADDRESS: Final = re.compile(r"([a-z0-9]+)://(.+)", re.DOTALL)
_CONNECT_S: Final = 5.0
_ANSWER_S: Final = 30.0
_ATTEMPTS: Final = 3
_PART: Final = 1 << 20
_SPARE: Final = 256 << 20
_CHECK: Final = "check the address, the network and the credentials, and scan again"


class UnreachedError(Exception):
    """A log in an object store could not be downloaded: a row of the store that a later scan tries again.

    Parameters
    ----------
    problem, remedy
        As of :class:`mavhums.MavhumsError`; no user meets this one.
    """

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(problem)
        self.problem, self.remedy = problem, remedy


def logs_in(sources: Iterable[str | os.PathLike[str]]) -> list[LogFile]:
    """Return the logs that the sources name, each once, by path.

    Parameters
    ----------
    sources
        Logs, folders with logs at any depth, or patterns; paths, or addresses such as ``s3://bucket/logs``.

    Raises
    ------
    MavhumsError
        If a source matches nothing, or cannot be listed.
    MissingExtraError
        If an address is given, and the packages of the extra ``fleet`` are not installed.
    """
    found: set[LogFile] = set()
    for source in (os.fspath(each) for each in sources):
        found.update(_remote(source) if "://" in source else chain.from_iterable(map(_files, _local(source))))
    return sorted(found)


@contextmanager
def at_hand(file: LogFile) -> Iterator[str]:
    """Give the path of a log on disk: its own, or that of a copy which is removed at the end.

    Raises
    ------
    UnreachedError
        If the log cannot be downloaded, or has changed since it was listed.
    """
    if "://" not in file.path:
        if "\\x" in file.path and not os.path.lexists(file.path):
            raise UnreachedError(f"{file.path}: its name is not UTF-8", "rename it, and scan again")
        yield file.path
        return
    with tempfile.TemporaryDirectory(prefix="mavhums-log-") as folder:
        copy = Path(folder, PurePosixPath(file.path).name)
        _download(file, copy)
        yield str(copy)


def _local(source: str) -> Iterator[Path]:
    try:
        is_folder = Path(source).is_dir() and os.listdir(source) is not None  # noqa: PTH208
    except OSError as error:
        raise MavhumsError(f"{source}: {error.strerror}", "check the permissions and the disk") from error
    if is_folder:
        found = [path for path in Path(source).rglob("*") if _is_named_log(path.name)]
    elif has_magic(source) and not Path(source).exists():
        found = [Path(path) for path in glob(source, recursive=True)]  # noqa: PTH207 — an absolute pattern
        if not found:
            raise MavhumsError(f"{source}: matches no log", "check the pattern")
    else:
        found = [Path(source)]
        if not found[0].exists():
            raise MavhumsError(f"{source}: no such file or folder", "check the path")
    return (path.absolute() for path in found if not path.is_dir())


def _is_named_log(name: str) -> bool:
    return bool(_LOG.fullmatch(name) or _ARCHIVE.fullmatch(name))


def _files(path: Path) -> Iterator[LogFile]:
    """Yield a log, or each log in an archive; one without any is judged as it is, and gives the reason."""
    file = LogFile.at(path)
    inside = []
    if _ARCHIVE.fullmatch(path.name):
        with suppress(UnreadableLogError, OSError):
            inside = members(path)
    logs = [one for one in inside if _LOG.fullmatch(one.filename)] if len(inside) > 1 else []
    if not logs:
        yield file
    for one in logs:
        yield LogFile(f"{path}/{one.filename}", one.file_size, file.time_ns)


def _remote(source: str) -> Iterator[LogFile]:
    """Yield the logs at an address.

    Raises
    ------
    MavhumsError
        If there are none, or the object store cannot be asked.
    """
    scheme, path = _parted(source)
    files = _filesystem(scheme)
    try:
        found = [*_listed(files, path.rstrip("/"))]
    except OSError as error:
        raise MavhumsError(f"{source}: cannot be listed: {_words(error)}", _CHECK) from error
    if not found:
        raise MavhumsError(f"{source}: matches no log", "check the address and the credentials")
    return (LogFile(f"{scheme}://{each.path}", each.size, each.mtime_ns) for each in found)


def _listed(files: FileSystem, path: str) -> Iterator[FileInfo]:
    from fsspec.utils import glob_translate
    from pyarrow.fs import FileSelector, FileType

    whole = files.get_file_info(path)
    if whole.type == FileType.File:
        yield whole
        return
    folder, pattern = path, None
    if whole.type == FileType.NotFound and has_magic(path):
        parts = PurePosixPath(path).parts
        plain = next(place for place, part in enumerate(parts) if has_magic(part))
        folder, pattern = "/".join(parts[:plain]), re.compile(glob_translate(path))
    selector = FileSelector(folder, recursive=True, allow_not_found=True)
    for each in files.get_file_info(selector):
        if each.type == FileType.File and (
            pattern.match(each.path) if pattern else _is_named_log(each.base_name)
        ):
            yield each


def _download(file: LogFile, copy: Path) -> None:
    if file.size + _SPARE > shutil.disk_usage(copy.parent).free:
        problem = f"{file.path}: no room for {file.size / 1e6:,.1f} MB in {copy.parent.parent}"
        raise UnreachedError(problem, "make room, or name another folder with TMPDIR, and scan again")
    scheme, path = _parted(file.path)
    try:
        with _filesystem(scheme).open_input_stream(path) as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target, _PART)
    except FileNotFoundError as error:
        raise UnreachedError(f"{file.path}: is no longer there", "scan again") from error
    except OSError as error:
        raise UnreachedError(f"{file.path}: cannot be read: {_words(error)}", _CHECK) from error
    if copy.stat().st_size != file.size:
        raise UnreachedError(f"{file.path}: changed while it was scanned", "scan again")


def _parted(address: str) -> tuple[str, str]:
    match = _ADDRESS.fullmatch(address)
    if match is None or match[1] not in ("s3", "gs"):
        raise MavhumsError(f"{address}: no address of logs", "name s3://BUCKET/PREFIX or gs://BUCKET/PREFIX")
    return match[1], match[2]


@cache
def _filesystem(scheme: str) -> FileSystem:
    """Return an object store, with credentials and region from the environment as for its own tools."""
    try:
        from pyarrow import fs
    except ImportError as error:
        raise MissingExtraError("logs in an object store", "fleet") from error
    if scheme == "gs":
        return fs.GcsFileSystem()
    endpoint = urlsplit(os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL") or "")
    return fs.S3FileSystem(
        scheme=endpoint.scheme or "https",
        endpoint_override=endpoint.netloc or None,
        region=os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION"),
        connect_timeout=_CONNECT_S,
        request_timeout=_ANSWER_S,
        retry_strategy=fs.AwsStandardS3RetryStrategy(max_attempts=_ATTEMPTS),
    )


def _words(error: OSError) -> str:
    """Return an error's message in one line."""
    return " ".join((error.strerror or str(error)).split())[:300]
