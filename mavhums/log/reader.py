"""Reads a log from disk, block by block or as a whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mavhums.core.errors import UnreadableLogError
from mavhums.core.packed import SequentialFile, opened
from mavhums.log.base.decoder import LogDecoder, Losses, Table, join_tables
from mavhums.log.formats import Decoder, refuse_foreign

if TYPE_CHECKING:
    import pandas as pd

_BLOCK = 1 << 20
_HEAD = 1 << 20  # bytes in which a log must show what it is


def read_blocks(
    path: str | os.PathLike[str],
    *,
    size: int = _BLOCK,
    dialect: str | os.PathLike[str] | None = None,
) -> Iterator[bytes]:
    """Yield the bytes of a log in blocks, unpacked if it is a .gz, .xz, .bz2 or .zst, or in a .zip.

    Parameters
    ----------
    path
        A ``.tlog`` file, or ``-``.
    size
        Bytes of a block.
    dialect
        The MAVLink XML with which the log will be decoded, if any.

    Raises
    ------
    UnreadableLogError
        If the file is missing, unreadable or not a telemetry log.
    DialectError
        If the XML cannot be used.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise UnreadableLogError(
                f"{path}: this is a folder", f"name the logs in it, for example {path}/*.tlog"
            )
        with opened(path) as file:
            zeros, head = _beginning(file)
            refuse_foreign(str(path), head, dialect=dialect)
            yield from (bytes(min(size, zeros - k)) for k in range(0, zeros, size))
            yield from (head[k : k + size] for k in range(0, len(head), size))
            while block := file.read(size):
                yield block
    except FileNotFoundError as error:
        raise UnreadableLogError(f"{path}: no such file", "check the path") from error
    except OSError as error:
        raise UnreadableLogError(f"{path}: {error.strerror}", "check the permissions and the disk") from error


def _beginning(file: SequentialFile) -> tuple[int, bytes]:
    """Return the number of zeros before the first block with anything else, and that block.

    A recorder that allots its file in advance leaves zeros before its first frame.
    """
    zeros, head = 0, file.read(_HEAD)
    while head and not head.strip(b"\0"):
        zeros += len(head)
        head = file.read(_HEAD)
    if not head:
        return 0, bytes(min(zeros, _HEAD))
    return zeros, head + file.read(_HEAD) if zeros or not head[0] else head


class Decoded(NamedTuple):
    """Tables decoded from a block, the bytes read so far, and whether it is the last block."""

    tables: Mapping[str, Table]
    size: int
    final: bool


def decode_blocks(
    path: str | os.PathLike[str],
    decoder: LogDecoder,
    *,
    dialect: str | os.PathLike[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Iterator[Decoded]:
    """Decode a log block by block; the last tables flush the decoder.

    Parameters
    ----------
    path, dialect
        As for :func:`read_blocks`.
    decoder
        New.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError, DialectError
        As :func:`read_blocks`.
    """
    size = 0
    for block in chain(read_blocks(path, dialect=dialect), (b"",)):  # the empty one ends the log
        size += len(block)
        yield Decoded(decoder.feed(block, final=not block), size, final=not block)
        if progress:
            progress(size)


@dataclass(frozen=True, eq=False)
class Log:
    """A whole log in memory.

    Attributes
    ----------
    path
        Path of the log.
    tables
        Messages by name, as columns.
    counts
        Number of intact messages by (system, component, name).
    unknown
        Number of frames by message id that the dialect does not define.
    losses
        What could not be read.
    vehicles
        System ids of the vehicles.
    span
        Times of reception of the first and the last frame, microseconds of UTC; None if empty.
    sender_clock
        Whether the log contains no date, so that all times count from the sender's boot.
    format
        Name of the log's format.
    """

    path: Path
    tables: dict[str, Table]
    counts: dict[tuple[int, int, str], int]
    unknown: dict[int, int]
    losses: Losses
    vehicles: tuple[int, ...]
    span: tuple[int, int] | None
    sender_clock: bool = False
    format: str = "tlog"

    @cached_property
    def messages(self) -> Mapping[str, pd.DataFrame]:
        """The messages by name, each a DataFrame indexed by time of reception, made when it is first read."""
        return _LazyFrames(self.tables)


class _LazyFrames(Mapping[str, "pd.DataFrame"]):
    """The DataFrame of each table, made at its first use: half the time of a short log goes into frames."""

    def __init__(self, tables: Mapping[str, Table]) -> None:
        self._tables = tables
        self._made: dict[str, pd.DataFrame] = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._made:
            self._made[name] = self._tables[name].to_frame()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)


def read_log(
    path: str | os.PathLike[str],
    *,
    messages: Iterable[str] | None = None,
    dialect: str | os.PathLike[str] | None = None,
) -> Log:
    """Read a whole log into memory; for long logs, feed ``read_blocks`` to an engine instead.

    Parameters
    ----------
    path
        A ``.tlog`` file, or ``-`` for the standard input.
    messages
        Names of the message types to keep; all if None.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.

    Raises
    ------
    UnreadableLogError
        If the file is missing, unreadable or not a telemetry log.
    DialectError
        If the XML cannot be used.

    Examples
    --------
    >>> log = read_log("flight.tlog")
    >>> float(log.messages["BATTERY_STATUS"]["voltages[0]"].median())
    27000.0
    >>> log.losses.any
    False
    """
    decoder = Decoder(messages, dialect=dialect)
    parts = list[Table]()
    for decoded in decode_blocks(path, decoder, dialect=dialect):
        parts += decoded.tables.values()
    first, last = decoder.first_time_us, decoder.last_time_us
    return Log(
        Path(path),
        join_tables(parts),
        decoder.counts,
        decoder.unknown,
        decoder.losses,
        decoder.vehicles,
        None if first is None or last is None else (first, last),
        decoder.undated,
        decoder.format,
    )
