"""The interface of all formats' decoders, and the choice of a decoder by the beginning of a log.

A new format is a package of its own and a line in `FORMATS`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from typing import Final, NamedTuple, Protocol, cast

from mavhums.core.errors import MavhumsError
from mavhums.log.losses import Losses
from mavhums.log.mavlink.decoder import MavlinkDecoder
from mavhums.log.tables import Table

__all__ = ["FORMATS", "Decoder", "Format", "LogDecoder", "Refusal", "format_of"]


class LogDecoder(Protocol):
    """Converts blocks of a log's bytes to tables of messages, in bounded memory.

    Names of messages and fields are the format's own. The tables do not depend on where
    blocks end; an unfinished record waits for the next block.
    """

    @property
    def format(self) -> str:
        """Name of the format, as in `FORMATS`, or ``tlog``."""
        ...

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (system, component, name), wanted or not.

        ``system`` is the vehicle's id; ``component`` distinguishes instances if the format has them.
        """
        ...

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Ids of the vehicles, increasing."""
        ...

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records with an undefined message id, by id."""
        ...

    @property
    def losses(self) -> Losses:
        """Losses so far: unreadable data, and data that the vehicle reports as not recorded."""
        ...

    @property
    def first_time_us(self) -> int | None:
        """Time of the first message, microseconds of UTC; None before it."""
        ...

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest message, microseconds of UTC; None before the first."""
        ...

    @property
    def undated(self) -> bool:
        """Whether the log contains no date, so that times count from the vehicle's boot."""
        ...

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        ...


class Refusal(NamedTuple):
    """The reason why a log cannot be read, formatted to follow "FILE: ", and the remedy."""

    problem: str
    remedy: str


class _Package(Protocol):
    """The interface of a format's package."""

    def decoder(self, messages: Collection[str] | None) -> LogDecoder:
        """Return a new decoder of the wanted message types, all if None."""
        ...

    def refusal(self, head: bytes) -> Refusal | None:
        """Return why a log that begins with ``head`` (up to 1 MB) cannot be read; None if it can."""
        ...


@dataclass(frozen=True, slots=True)
class Format:
    """A log format other than MAVLink; a log without a signature is treated as MAVLink.

    Attributes
    ----------
    name
        Name in inspections and assessments.
    title
        Name in error messages: "this is …".
    signature
        The first bytes of every such log.
    clue
        What occurs several times near the beginning, by which a log with damaged first bytes is recognised.
    package
        Package of its decoder; imported with the first such log.
    """

    name: str
    title: str
    signature: bytes
    clue: re.Pattern[bytes]
    package: str

    def load(self) -> _Package:
        """Import the package."""
        return cast(_Package, import_module(self.package))


_FMT_BEFORE_FMT = re.compile(rb"\xa3\x95\x80(?=.{86}\xa3\x95\x80)", re.DOTALL)
_TOPIC = re.compile(rb"\w:uint64_t timestamp;")

FORMATS: Final[tuple[Format, ...]] = (
    Format(
        "dataflash",
        "an ArduPilot DataFlash log (.BIN)",
        b"\xa3\x95",
        _FMT_BEFORE_FMT,
        "mavhums.log.dataflash",
    ),
    Format("ulog", "a PX4 ULog (.ulg)", b"ULog\x01\x12\x35", _TOPIC, "mavhums.log.ulog"),
)
_CLUES: Final = 3
_SEARCHED: Final = 1 << 16
_MAVLINK_AT: Final = (0, 8)  # a frame comes first, or after a time stamp
_MAVLINK: Final = (0xFD, 0xFE)
_LONGEST: Final = max(*_MAVLINK_AT, *(len(known.signature) for known in FORMATS)) + 1


def format_of(head: bytes) -> Format | None:
    """Return the format of a log that begins with ``head``; None for a MAVLink log.

    If the log begins neither with a signature nor with a MAVLink frame, its first 64 KB are searched.

    Examples
    --------
    >>> format_of(b"\\xa3\\x95\\x80\\x80").name
    'dataflash'
    """
    signed = next((known for known in FORMATS if head.startswith(known.signature)), None)
    if signed is not None or _begins_with_frame(head):
        return signed
    searched = head[:_SEARCHED]
    clues = ((known, sum(1 for _ in islice(known.clue.finditer(searched), _CLUES))) for known in FORMATS)
    return next((known for known, count in clues if count == _CLUES), None)


def _begins_with_frame(head: bytes) -> bool:
    return any(len(head) > at and head[at] in _MAVLINK for at in _MAVLINK_AT)


def _is_settled(head: bytes) -> bool:
    """Return whether later bytes do not change the format."""
    signed = any(head.startswith(known.signature) for known in FORMATS)
    return len(head) >= _LONGEST and (len(head) >= _SEARCHED or signed or _begins_with_frame(head))


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
        self._for_mavlink = "dialect" if dialect is not None else "key" if key is not None else None
        self._chosen: LogDecoder = MavlinkDecoder(self._wanted, dialect=dialect, key=key)
        self._head: bytes | None = b""

    @property
    def format(self) -> str:
        """Name of the format."""
        return self._chosen.format

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (system, component, name), wanted or not."""
        return self._chosen.counts

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Ids of the vehicles, increasing."""
        return self._chosen.vehicles

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records with an undefined message id, by id."""
        return self._chosen.unknown

    @property
    def losses(self) -> Losses:
        """What could not be read so far."""
        return self._chosen.losses

    @property
    def first_time_us(self) -> int | None:
        """Time of the first message, microseconds of UTC; None before it."""
        return self._chosen.first_time_us

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest message, microseconds of UTC; None before the first."""
        return self._chosen.last_time_us

    @property
    def undated(self) -> bool:
        """Whether the log contains no date, so that times count from the vehicle's boot."""
        return self._chosen.undated

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows.

        Raises
        ------
        MavhumsError
            If the log is of another format and ``dialect`` or ``key`` was given.
        """
        if self._head is not None:
            block = self._head = self._head + block
            if not (final or _is_settled(block)):
                return {}
            self._choose(block)
        return self._chosen.feed(block, final=final)

    def _choose(self, head: bytes) -> None:
        self._head = None
        known = format_of(head)
        if known is None:
            return
        if self._for_mavlink:
            raise MavhumsError(
                f"this is {known.title}: a {self._for_mavlink} is for MAVLink logs alone",
                f"leave --{self._for_mavlink} out",
            )
        self._chosen = known.load().decoder(self._wanted)
