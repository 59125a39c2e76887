"""The log formats, and the choice of a log's decoder by its first bytes. It imports nothing heavy.

A new format is a package of its own, which is imported with the first such log, and a line in `FORMATS`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, cast

from mavhums.core.errors import MavhumsError, UnreadableLogError

if TYPE_CHECKING:
    from mavhums.log.base.decoder import FormatPackage, LogDecoder, Losses, Table


@dataclass(frozen=True, slots=True)
class Format:
    """A log format.

    Attributes
    ----------
    name
        Name in inspections and assessments.
    title
        Name in error messages: "this is …".
    suffixes
        Suffixes of its files, in small letters.
    package
        Package of its decoder.
    signature
        The first bytes of every such log; empty if it has none.
    clue
        What occurs several times near the beginning, by which a log with damaged first bytes is recognised.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    package: str
    signature: bytes
    clue: re.Pattern[bytes]


MAVLINK: Final = Format(
    "tlog",
    "a MAVLink telemetry log (.tlog)",
    (".tlog",),
    "mavhums.log.mavlink",
    b"",
    re.compile(rb"(?!)"),
)
"""The format without a signature: what no other format claims."""

FORMATS: Final = (
    MAVLINK,
    Format(
        "dataflash",
        "an ArduPilot DataFlash log (.BIN)",
        (".bin",),
        "mavhums.log.dataflash",
        b"\xa3\x95",
        re.compile(rb"\xa3\x95\x80(?=.{86}\xa3\x95\x80)", re.DOTALL),  # a definition directly after another
    ),
    Format(
        "ulog",
        "a PX4 ULog (.ulg)",
        (".ulg",),
        "mavhums.log.ulog",
        b"ULog\x01\x12\x35",
        re.compile(rb"\w:uint64_t timestamp;"),  # the definition of a topic
    ),
)
_SIGNED: Final = tuple(known for known in FORMATS if known.signature)

SUFFIXES: Final = tuple(suffix for known in FORMATS for suffix in known.suffixes)

_CLUES: Final = 3
_PIECE: Final = 1 << 16
_SEARCHED: Final = 1 << 16
_FRAME_AT: Final = (0, 8)  # a MAVLink frame comes first, or after a time stamp
_FRAME: Final = (0xFD, 0xFE)
_LONGEST: Final = max(*_FRAME_AT, *(len(known.signature) for known in _SIGNED)) + 1


def format_of(head: bytes) -> Format:
    """Return the format of a log that begins with ``head``; `MAVLINK` for what no other format claims.

    If the log begins neither with a signature nor with a MAVLink frame, its first 64 KB are searched.

    Examples
    --------
    >>> format_of(b"\\xa3\\x95\\x80\\x80").name
    'dataflash'
    """
    signed = _signed(head)
    if signed is not None or _begins_with_frame(head):
        return signed or MAVLINK
    searched = head[:_SEARCHED]
    clues = ((known, sum(1 for _ in islice(known.clue.finditer(searched), _CLUES))) for known in _SIGNED)
    return next((known for known, count in clues if count == _CLUES), MAVLINK)


def _is_certain(head: bytes) -> bool:
    """Return whether later bytes do not change the format."""
    found = _signed(head) is not None or _begins_with_frame(head)
    return len(head) >= _LONGEST and (len(head) >= _SEARCHED or found)


def _signed(head: bytes) -> Format | None:
    return next((known for known in _SIGNED if head.startswith(known.signature)), None)


def _begins_with_frame(head: bytes) -> bool:
    return any(len(head) > at and head[at] in _FRAME for at in _FRAME_AT)


_RECORD = (
    "mavhums reads .tlog (a ground station's), .BIN (ArduPilot's) and .ulg (PX4's): "
    "take one of these, or record a .tlog with the ground station or with MAVProxy"
)
_FOREIGN = (
    (rb"\ARRF2", "a Rerun recording, not a log", _RECORD),
    (rb"\A\x1f\x8b", "gzip-compressed", "unpack it first"),
    (rb"\APK\x03\x04", "a zip archive", "unpack it first"),
    (rb"\AULogEnc", "an encrypted ULog", "decrypt it first with your key (PX4: Tools/decrypt_ulog.py)"),
    (
        rb"\A\s*FMT, *128, *89,",
        "a DataFlash log dumped as text",
        "download the .BIN itself from the autopilot",
    ),
    (
        rb"(?m)^\s*\[\[ *actuators *\]\]",
        "an airframe profile, not a log",
        "pass it with --airframe, and name the log instead",
    ),
)
"""What another file contains, what it then is, and the remedy."""


def _of_chosen(name: str) -> Any:
    return property(attrgetter(f"chosen.{name}"), doc=f"See `LogDecoder.{name}`.")


class Decoder:
    """Decoder of a log in any format, chosen by the first bytes: a `LogDecoder`.

    Parameters
    ----------
    messages
        Names of the wanted message types, of any format; all if None. Others are checked
        and counted but not unpacked.
    dialect
        For a MAVLink log: an XML file whose definitions take precedence over the shipped ones.
    key
        For a MAVLink log: 32 bytes; only frames signed with it count. If None, signatures are not
        looked at.

    Raises
    ------
    DialectError
        If the XML cannot be used.

    Examples
    --------
    >>> Decoder().feed(b"not a log", final=True)
    {}
    """

    def __init__(
        self,
        messages: Iterable[str] | None = None,
        *,
        dialect: str | os.PathLike[str] | None = None,
        key: bytes | None = None,
    ) -> None:
        self._wanted = None if messages is None else frozenset(messages)
        self._mavlink_options: dict[str, Any] = {"dialect": dialect, "key": key}
        self._for_mavlink = "dialect" if dialect is not None else "key" if key is not None else None
        # An unusable dialect is an error now; else MAVLink's definitions wait until a log needs them.
        self._chosen = self._mavlink() if self._for_mavlink else None
        self._head: bytes | None = b""

    format: str = _of_chosen("format")
    counts: dict[tuple[int, int, str], int] = _of_chosen("counts")
    vehicles: tuple[int, ...] = _of_chosen("vehicles")
    unknown: dict[int, int] = _of_chosen("unknown")
    losses: Losses = _of_chosen("losses")
    first_time_us: int | None = _of_chosen("first_time_us")
    last_time_us: int | None = _of_chosen("last_time_us")
    undated: bool = _of_chosen("undated")
    ahead_us: int = _of_chosen("ahead_us")

    @property
    def chosen(self) -> LogDecoder:
        """The decoder in use; before the format is certain, MAVLink's."""
        if self._chosen is None:
            self._chosen = self._mavlink()
        return self._chosen

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows.

        Raises
        ------
        MavhumsError
            If the log is of another format and ``dialect`` or ``key`` was given.
        """
        # The bytes before the format is certain wait: a signature may be cut by the end of a block.
        if self._head is not None:
            block = self._head = self._head + block
            if not (final or _is_certain(block)):
                return {}
            self._head = None
            known = format_of(block)
            if known is not MAVLINK:
                if self._for_mavlink:
                    problem = f"this is {known.title}: a {self._for_mavlink} is for MAVLink logs alone"
                    raise MavhumsError(problem, f"leave --{self._for_mavlink} out")
                self._chosen = _package(known).decoder(self._wanted)
        return self.chosen.feed(block, final=final)

    def _mavlink(self) -> LogDecoder:
        from mavhums.log.mavlink.decoder import MavlinkDecoder

        return MavlinkDecoder(self._wanted, **self._mavlink_options)


def _package(known: Format) -> FormatPackage:
    return cast("FormatPackage", import_module(known.package))


def refuse_foreign(name: str, head: bytes, *, dialect: str | os.PathLike[str] | None = None) -> None:
    """Raise if a file that begins with ``head`` is not a telemetry log.

    Raises
    ------
    UnreadableLogError
        If it is not; the error names the probable file type and the remedy.
    """
    if not head:
        raise UnreadableLogError(
            f"{name}: the file is empty", "check that the ground station had closed the log"
        )
    if not head.strip(b"\0"):
        raise UnreadableLogError(f"{name}: the file contains only zeros", "copy the log again")
    known = format_of(head)
    if known is not MAVLINK:
        refused = _package(known).refusal(head)
        if refused is not None:
            raise UnreadableLogError(f"{name}: {refused.problem}", refused.remedy)
        if dialect is not None:
            problem = f"{name}: this is {known.title}: a dialect is for MAVLink logs alone"
            raise UnreadableLogError(problem, "leave --dialect out")
        return
    if _contains_frames(head, dialect):
        return
    for pattern, kind, remedy in _FOREIGN:
        if re.search(pattern, head):
            raise UnreadableLogError(f"{name}: this is {kind}", remedy)
    if _is_text(head):
        raise UnreadableLogError(f"{name}: this is a text file, not an aircraft's log", _RECORD)
    raise UnreadableLogError(
        f"{name}: neither a MAVLink frame nor the beginning of a .BIN or .ulg "
        f"found in the first {len(head)} bytes",
        _RECORD,
    )


def pieces(head: bytes) -> Iterator[tuple[bytes, bool]]:
    """Yield a log's beginning in pieces, the first of which usually decides, and whether each is the last."""
    for place in range(0, len(head), _PIECE):
        yield head[place : place + _PIECE], place + _PIECE >= len(head)


def _contains_frames(head: bytes, dialect: str | os.PathLike[str] | None) -> bool:
    decoder = Decoder((), dialect=dialect).chosen
    for piece, final in pieces(head):
        decoder.feed(piece, final=final)
        if decoder.counts or decoder.unknown:
            return True
    return False


def _is_text(head: bytes) -> bool:
    try:
        text = head[: len(head) - 4].decode("utf-8")
    except UnicodeDecodeError:
        return False
    return all(character.isprintable() or character.isspace() for character in text)
