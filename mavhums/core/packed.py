"""Reading of compressed or archived files, block by block, without unpacking to disk.

The first bytes determine the type of a file, not its name. The path of a member of a zip archive is the
archive's path and its own: ``flights.zip/2026-05-01/flight.ulg``.
"""

from __future__ import annotations

import bz2
import errno
import io
import lzma
import os
import re
import stat
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any, Final, cast

from mavhums.core.errors import MissingExtraError, UnreadableLogError

COMPRESSED: Final = (".gz", ".xz", ".bz2", ".zst")
"""Suffixes of the compressed files that are read; the page and a fleet's scan offer the same."""

ARCHIVES: Final = (".zip",)
"""Suffixes of the archives that are read."""

_GZIP, _ZSTD, _ZIP = b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"PK\x03\x04"
_XZ: Final = b"\xfd7zXZ\x00"
_BZIP2: Final = re.compile(rb"BZh[1-9](1AY&SY|\x17rE8P\x90)")
_HEAD: Final = 10
_XZ_MEMORY: Final = 1 << 28
_PIECE: Final = 1 << 16
_MOST_LAYERS: Final = 3
_FREE: Final = 1 << 30
_RATIO: Final = 200
_ZSTD_WINDOW: Final = 1 << 27
_PACKED_PIECE: Final = 1 << 11  # small: n bytes of Zstandard may expand to 32,768 n
_MEMBERS_NAMED: Final = 10
# Descriptors that the caller has opened: <(...) of a shell is one of them.
_HELD: Final = re.compile(r"-|/dev/stdin|/(?:dev|proc/self)/fd/(\d+)")


class SequentialFile:
    """A file that is read sequentially.

    Attributes
    ----------
    free, ratio
        Reading fails when more than ``free`` bytes, and ``ratio`` times the packed file's, are unpacked.
    """

    free = _FREE
    ratio = _RATIO

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self._path = path
        self._packed = _CountingReader(file)
        self._source: Any = file if hasattr(file, "peek") else io.BufferedReader(cast(Any, file))
        self._plain = True
        self._size = 0

    def read(self, size: int) -> bytes:
        """Return up to ``size`` bytes; an empty result is the end of the file.

        Raises
        ------
        UnreadableLogError
            If the packed data is damaged, or expands beyond the limit.
        OSError
            If the file cannot be read.
        """
        if self._plain:
            return cast(bytes, self._source.read(size))
        with _translated(self._path):
            data = cast(bytes, self._source.read(size))
        self._size += len(data)
        if self._size > max(self.free, self.ratio * self._packed.count):
            problem = f"{self._path}: expands to more than {self.ratio} times its size, which no log does"
            raise UnreadableLogError(problem, "unpack it and check its contents")
        return data

    def unpack(self) -> None:
        """Decompress the file if its first bytes identify a compressed format."""
        for _ in range(_MOST_LAYERS):
            with _translated(self._path):
                begin = _compression(self._source.peek(_HEAD))
            if begin is None:
                return
            if self._plain:
                self._plain = False
                self._packed = _CountingReader(self._source)
                self._source = io.BufferedReader(self._packed)
            self._source = io.BufferedReader(_Pieces(_stream_pieces(self._source, begin)))

    def enter(self, archive: zipfile.ZipFile, member: str | None) -> None:
        """Continue with a member of the archive, or with its only one if None."""
        with _translated(self._path):
            chosen = _chosen(self._path, archive, member)
            self._source = io.BufferedReader(archive.open(chosen))
        self._packed.count = chosen.compress_size
        self._plain = False

    def is_archive(self) -> bool:
        """Return whether the file is a zip archive."""
        return cast(bytes, self._source.peek(len(_ZIP))).startswith(_ZIP)


class ArchiveError(UnreadableLogError):
    """An archive holds several files, and none is named."""


def members(path: Path) -> list[zipfile.ZipInfo]:
    """Return the files in a zip archive, without those that macOS adds.

    Raises
    ------
    UnreadableLogError
        If it is not an intact archive.
    OSError
        If it cannot be read.
    """
    with _translated(path), opened_file(path) as file, zipfile.ZipFile(file) as archive:
        return _members(archive)


def is_stream(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is a stream that the caller has opened: ``-``, ``/dev/stdin`` or ``<(...)``.

    It can be read only once, and by this process only.
    """
    return bool(_HELD.fullmatch(os.fspath(path))) and not os.path.isfile(path)  # noqa: PTH113


def opened_file(path: Path) -> io.BufferedReader:
    """Open a regular file, without ever waiting for another program.

    Raises
    ------
    UnreadableLogError
        If it is a FIFO, a device or a socket: reading from them may never end.
    OSError
        If the file cannot be opened.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        file = open(path, "rb", opener=lambda name, _: os.open(name, flags))  # noqa: SIM115
        # The type of the opened file counts: until now the name could be given to another one.
        if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            return file
        file.close()
    except OSError as error:
        if error.errno != errno.ENXIO:  # that is the answer of a socket
            raise
    remedy = f"save its data to a file; or pipe them: mavhums analyse - < {path}"
    raise UnreadableLogError(f"{path}: is a pipe, a device or a socket, not a file", remedy)


@contextmanager
def opened(path: Path) -> Iterator[SequentialFile]:
    """Open a file, one compressed with gzip, xz, bzip2 or Zstandard, or a member of a zip archive.

    Parameters
    ----------
    path
        Of a stream (:func:`is_stream`), the data may be compressed but must not be an archive.

    Raises
    ------
    ArchiveError
        If an archive holds several files and none is named.
    UnreadableLogError
        If the named one is not in it.
    MissingExtraError
        If Zstandard is not installed.
    OSError
        If the file cannot be read.
    """
    file, member = _located(path)
    streamed = is_stream(path)
    with ExitStack() as stack:
        raw = _stream(path) if streamed else stack.enter_context(opened_file(file))
        unpacked = SequentialFile(path, raw)
        if not streamed and unpacked.is_archive():
            with _translated(path):
                archive = stack.enter_context(zipfile.ZipFile(raw))
            unpacked.enter(archive, member)
        elif member is not None:
            raise UnreadableLogError(f"{path}: {file} is a file, not a zip archive", "check the path")
        unpacked.unpack()
        yield unpacked


def _stream(path: Path) -> IO[bytes]:
    """Return a stream that the caller has opened; to open its path anew could wait for a writer."""
    held = _HELD.fullmatch(str(path))
    if held and held[1] and int(held[1]):
        return open(int(held[1]), "rb", closefd=False)
    return sys.stdin.buffer


class _CountingReader(io.RawIOBase):
    """Counts the bytes read from a file."""

    def __init__(self, file: IO[bytes]) -> None:
        self.count = 0
        self._file = file

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any, /) -> int:
        data = self._file.read(len(buffer))
        buffer[: len(data)] = data
        self.count += len(data)
        return len(data)


class _Pieces(io.RawIOBase):
    """A file of pieces that come one after the other."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._ready = memoryview(b"")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any, /) -> int:
        while not self._ready:
            piece = next(self._pieces, None)
            if piece is None:
                return 0
            self._ready = memoryview(piece)
        size = min(len(buffer), len(self._ready))
        buffer[:size] = self._ready[:size]
        self._ready = self._ready[size:]
        return size


def _stream_pieces(file: IO[bytes], begin: Callable[[], Any]) -> Iterator[bytes]:
    """Unpack streams that follow each other, in bounded memory, which the libraries' own readers do not.

    A stream of bzip2 or xz can expand without bound, so its output is limited; others expand a small piece to
    a few megabytes.
    """
    packed = b""
    while packed := packed or file.read(_PACKED_PIECE):
        packed = packed.lstrip(b"\0")  # padding
        if not packed:
            continue
        stream = begin()
        while not stream.eof:
            limited = hasattr(stream, "needs_input")
            if not packed and (not limited or stream.needs_input):
                packed = file.read(_PACKED_PIECE)
                if not packed:
                    raise EOFError("a stream is cut")
            yield stream.decompress(packed, _PIECE) if limited else stream.decompress(packed)
            packed = b""
        packed = stream.unused_data


def _located(path: Path) -> tuple[Path, str | None]:
    """Return the file of a path, and the path of a member in it."""
    if not path.exists():
        for parent in path.parents:
            if parent.is_file():
                return parent, path.relative_to(parent).as_posix()
    return path, None


def _chosen(path: Path, archive: zipfile.ZipFile, member: str | None) -> zipfile.ZipInfo:
    """Return the named member, or the only one."""
    found = _members(archive)
    names = [info.filename for info in found]
    if member in names:
        return found[names.index(member)]
    if not names:
        raise UnreadableLogError(
            f"{path}: the archive contains no file", "choose an archive that contains a log"
        )
    if member is None and len(names) == 1:
        return found[0]
    given = ", ".join(names[:_MEMBERS_NAMED]) + (", …" if len(names) > _MEMBERS_NAMED else "")
    if member is None:
        remedy = f"name one, for example {path}/{names[0]}"
        raise ArchiveError(f"{path}: the archive contains {len(names)} files: {given}", remedy)
    raise UnreadableLogError(f"{path}: the archive has no such member", f"it holds {given}")


def _members(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    return [
        info
        for info in archive.infolist()
        if not info.is_dir() and info.file_size and not info.filename.startswith("__MACOSX/")
    ]


def _compression(head: bytes) -> Callable[[], Any] | None:
    """Return what begins to unpack a stream that begins so; None if it is not compressed."""
    if head.startswith(_GZIP):
        return partial(zlib.decompressobj, 16 + zlib.MAX_WBITS)  # 16: with gzip's header
    if head.startswith(_ZSTD):
        return cast("Callable[[], Any]", _zstd_decompressor().decompressobj)
    if head.startswith(_XZ):
        return partial(lzma.LZMADecompressor, lzma.FORMAT_XZ, memlimit=_XZ_MEMORY)
    return bz2.BZ2Decompressor if _BZIP2.match(head) else None


def _zstd_decompressor() -> Any:
    try:
        import zstandard
    except ModuleNotFoundError as error:
        raise MissingExtraError("reading .zst", "zstd") from error
    return zstandard.ZstdDecompressor(max_window_size=_ZSTD_WINDOW)


@contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Convert a library's errors about packed data to errors with a remedy."""
    damaged: list[type[Exception]] = [
        EOFError,
        zlib.error,
        lzma.LZMAError,
        OSError,
        zipfile.BadZipFile,
    ]
    zstandard = sys.modules.get("zstandard")
    if zstandard is not None:
        damaged.append(zstandard.ZstdError)
    try:
        yield
    except tuple(damaged) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise  # of the disk; gzip's and bzip2's errors about its data have no number
        problem = f"{path}: the packed data is damaged or cut ({error})"
        raise UnreadableLogError(problem, "copy it again; or unpack what is intact, and read that") from error
    except (RuntimeError, NotImplementedError) as error:
        raise UnreadableLogError(f"{path}: cannot be unpacked here ({error})", "unpack it first") from error
